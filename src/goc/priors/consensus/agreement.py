"""How often two views give the same surface point the same id: a cheap test of given ids."""

import numpy as np
import torch
from jaxtyping import Float64, Int16
from scipy.ndimage import maximum_filter, minimum_filter

from goc.priors.segmentation.surface_voxels import back_project, by_name, depth_of
from goc.scene import ROOM, UNLABELLED, Camera, Capture, Frame

VIEWS = 24
"""Views that are compared, each with its neighbour."""
ACROSS = 80
"""Points that are compared, along the longer side of a view."""
NEAR = 0.02
"""A neighbour sees the same point where its depth differs by less than this share."""
LEAST_SHARE = 0.5
"""A neighbour looks at more than this share of a view's points."""
FEWEST = 50
"""Points of objects without which nothing can be said."""


def agreement(views: Capture) -> float | None:
    """Share of the points on objects, in a sample of views, that have the same id in a neighbouring view.

    Points of the room in both views do not count, as they would hide what happens to objects; nor do unlabelled ones,
    and those next to another id.

    Returns:
        0 to 1; None where too few points are seen twice.
    """
    order = by_name(views)
    chosen = sorted({order[round(i)] for i in np.linspace(0, len(order) - 1, min(len(order), VIEWS))})
    same = total = 0
    for index in chosen:
        frame = views[index]
        points, ids = _samples(frame)
        if not len(points):
            continue
        for other in _neighbours(views, order, points, index):
            there = _looked_up(views[other], points)
            known = (there != UNLABELLED) & ((ids != ROOM) | (there != ROOM))
            same += int((ids == there)[known].sum())
            total += int(known.sum())
    return same / total if total >= FEWEST else None


def _samples(frame: Frame) -> tuple[Float64[np.ndarray, "p 3"], Int16[np.ndarray, "p"]]:
    """Points of a grid of pixels with depth and an id that those around them share."""
    z = depth_of(frame)
    if z is None or frame.ids is None:
        return np.zeros((0, 3)), np.zeros(0, np.int16)
    stride = max(1, max(z.shape) // ACROSS)
    ids = _inner(frame.ids.numpy())[::stride, ::stride]
    kept = np.isfinite(z[::stride, ::stride]) & (ids != UNLABELLED)
    return back_project(z, frame.camera, stride)[kept], ids[kept]


def _inner(ids: Int16[np.ndarray, "h w"]) -> Int16[np.ndarray, "h w"]:
    """Ids, without pixels next to another id."""
    return np.where(minimum_filter(ids, 3) == maximum_filter(ids, 3), ids, np.int16(UNLABELLED))


def _neighbours(views: Capture, order: list[int], points: Float64[np.ndarray, "p 3"], index: int) -> list[int]:
    """The view that looks at most of the points, of those the one nearest by; by cameras alone."""
    few = points[:: max(1, len(points) // 64)]
    cameras = [views.cameras[other] for other in order]
    to_camera = np.stack([camera.cam_from_world.numpy() for camera in cameras])
    lens = np.stack([np.concatenate([camera.focal_px.numpy(), camera.centre_px.numpy()]) for camera in cameras])
    size = np.array([(camera.width, camera.height) for camera in cameras])
    local = np.einsum("nij,pj->npi", to_camera[:, :3, :3], few) + to_camera[:, None, :3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = local[..., :2] / local[..., 2:] * lens[:, None, :2] + lens[:, None, 2:]
        inside = (local[..., 2] > 0) & (pixels >= 0).all(-1) & (pixels < size[:, None]).all(-1)
    share = np.round(inside.mean(1), 1)
    eyes = np.stack([camera.position.numpy() for camera in cameras])
    away = np.linalg.norm(eyes - views.cameras[index].position.numpy(), axis=1)
    ranked = [row for row in np.lexsort((away, -share)) if order[row] != index and share[row] > LEAST_SHARE]
    return [order[row] for row in ranked[:1]]


def _projected(points: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Column, row and z of points, and whether they lie in the image."""
    projected = camera.double().project(torch.from_numpy(points))
    pixels, z = projected[0].numpy(), projected[1].numpy()
    with np.errstate(invalid="ignore"):
        x, y = np.floor(pixels[:, 0]), np.floor(pixels[:, 1])
        inside = (z > 0) & (x >= 0) & (y >= 0) & (x < camera.width) & (y < camera.height)
    return np.where(inside, x, 0).astype(int), np.where(inside, y, 0).astype(int), z, inside


def _looked_up(frame: Frame, points: np.ndarray) -> Int16[np.ndarray, "p"]:
    """Ids that a view gives to points; UNLABELLED where it sees something else."""
    z = depth_of(frame)
    if z is None or frame.ids is None:
        return np.full(len(points), UNLABELLED, np.int16)
    x, y, depth, inside = _projected(points, frame.camera)
    with np.errstate(invalid="ignore"):
        hit = inside & (np.abs(z[y, x] - depth) < NEAR * depth)
    return np.where(hit, _inner(frame.ids.numpy())[y, x], np.int16(UNLABELLED))
