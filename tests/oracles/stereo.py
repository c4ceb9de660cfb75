"""Matching costs of stereo, pixel by pixel in float64, from the cameras themselves."""

import numpy as np

from goc.scene import Camera

GREY_NOISE = 0.4


def rays(camera: Camera) -> np.ndarray:
    x = (np.arange(camera.width) + 0.5 - camera.centre_px[0].item()) / camera.focal_px[0].item()
    y = (np.arange(camera.height) + 0.5 - camera.centre_px[1].item()) / camera.focal_px[1].item()
    return np.stack([*np.meshgrid(x, y), np.ones((camera.height, camera.width))], -1)


def land(points: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Pixel-centre coordinates of world points, and their depth."""
    pose = camera.cam_from_world.double().numpy()
    local = points @ pose[:3, :3].T + pose[:3, 3]
    pixels = local[..., :2] / local[..., 2:] * camera.focal_px.double().numpy() + camera.centre_px.double().numpy()
    return pixels - 0.5, local[..., 2]


def look_up(grey: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Bilinear greys of the rounded image, clamped to it."""
    rounded = np.floor(grey + 0.5)
    last = np.array([grey.shape[1] - 1, grey.shape[0] - 1])
    at = np.clip(np.nan_to_num(at), 0, last)
    low = np.minimum(at.astype(int), last)
    high = np.minimum(low + 1, last)
    x, y = np.moveaxis(at - low, -1, 0)
    above = rounded[low[..., 1], low[..., 0]] * (1 - x) + rounded[low[..., 1], high[..., 0]] * x
    below = rounded[high[..., 1], low[..., 0]] * (1 - x) + rounded[high[..., 1], high[..., 0]] * x
    return above * (1 - y) + below * y


def inside(at: np.ndarray, depth: np.ndarray, camera: Camera) -> np.ndarray:
    return (depth > 0) & (at > -0.5).all(-1) & (at < np.array([camera.width, camera.height]) - 0.5).all(-1)


def one_minus_zncc(a: np.ndarray, b: np.ndarray, weight: np.ndarray) -> float:
    weight = weight / weight.sum()
    mean_a, mean_b = (weight * a).sum(), (weight * b).sum()
    var_a, var_b = (weight * (a - mean_a) ** 2).sum(), (weight * (b - mean_b) ** 2).sum()
    likeness = (weight * (a - mean_a) * (b - mean_b)).sum() / np.sqrt((var_a + GREY_NOISE**2) * (var_b + GREY_NOISE**2))
    return float(1 - np.clip(likeness, 0, 1))


def sweep_costs(greys: list[np.ndarray], cameras: list[Camera], others: list[int], inverse: float) -> np.ndarray:
    """Mean of the three best of view 0's costs against `others` on one fronto-parallel plane; 5×5 windows."""
    camera, grey = cameras[0], greys[0].astype(np.float64)
    pose = camera.world_from_cam.double().numpy()
    points = rays(camera) / inverse @ pose[:3, :3].T + pose[:3, 3]
    rows, columns = grey.shape
    costs = []
    for other in others:
        at, depth = land(points, cameras[other])
        warped, seen = look_up(greys[other], at), inside(at, depth, cameras[other])
        cost = np.ones(grey.shape)
        for y, x in np.argwhere(seen):
            window = np.ix_(
                np.clip(np.arange(y - 2, y + 3), 0, rows - 1), np.clip(np.arange(x - 2, x + 3), 0, columns - 1)
            )
            cost[y, x] = one_minus_zncc(grey[window], warped[window], np.ones((5, 5)))
        costs.append(cost)
    padded = np.concatenate([np.sort(np.stack(costs), 0), np.ones((3, rows, columns))])
    return padded[:3].mean(0)


def patch_cost(
    greys: list[np.ndarray], cameras: list[Camera], others: list[int], pixel: tuple[int, int], plane: np.ndarray
) -> float:
    """The same for the 4×4 samples, two pixels apart, round one pixel (x, y) of view 0 on a slanted plane."""
    camera, grey = cameras[0], greys[0].astype(np.float64)
    offsets = np.array([[2.0 * (i - 1.5), 2.0 * (j - 1.5)] for j in range(4) for i in range(4)])
    x = np.clip(pixel[0] + offsets[:, 0].astype(int), 0, camera.width - 1)
    y = np.clip(pixel[1] + offsets[:, 1].astype(int), 0, camera.height - 1)
    own = grey[y, x]
    weight = 1 / (1 + ((own - grey[pixel[1], pixel[0]]) / 25.0) ** 2)
    inverse = plane[0] + offsets @ plane[1:]
    focal, centre = camera.focal_px.double().numpy(), camera.centre_px.double().numpy()
    pose = camera.world_from_cam.double().numpy()

    def points(at: np.ndarray, inverse: np.ndarray) -> np.ndarray:
        rays = np.concatenate([(at + 0.5 - centre) / focal, np.ones((len(at), 1))], 1)
        return rays / inverse[:, None] @ pose[:3, :3].T + pose[:3, 3]

    costs = [1.0, 1.0, 1.0]
    for other in others:
        seen = inside(*land(points(np.array([pixel]), plane[:1]), cameras[other]), cameras[other])
        if seen[0]:
            there = look_up(greys[other], land(points(np.array(pixel) + offsets, inverse), cameras[other])[0])
            costs.append(one_minus_zncc(own, there, weight))
    return float(np.mean(sorted(costs)[:3]))
