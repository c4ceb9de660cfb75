"""Which views see the same surface from far enough apart to measure it: a choice from poses alone."""

import math
from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float64, Int32

from goc.scene.camera import Camera

_BEST_RAD = math.radians(10.0)
_NARROW_RAD, _WIDE_RAD = math.radians(5.0), math.radians(12.0)
_APART_RAD = math.radians(6.0)
_GRID = 5
_DEPTHS = (0.6, 1.0, 1.6)


def parallax_views(cameras: Sequence[Camera], distance: float, count: int) -> Int32[np.ndarray, "v k"]:
    """Choose for each view the others that see most of the same surface at angles that suit stereo; -1 = none.

    Each view's pixels are sampled on a 5 by 5 grid at 0.6, 1 and 1.6 times `distance`. A view scores by the share of
    those points inside its frame, each weighted by the angle between the two rays (best at 10°: less measures badly,
    more looks different; Yao et al. 2018) and by the change of scale. Views are taken greedily; one that looks from
    where a chosen one does adds little.

    Args:
        cameras: the views.
        distance: typical depth of the scene, scene units.
        count: columns of the result.

    Returns:
        Rows of indices into `cameras`, best first; never the view itself.
    """
    positions = np.stack([camera.position.double().numpy() for camera in cameras])
    chosen = np.full((len(cameras), count), -1, np.int32)
    lenses = _Lenses(cameras)
    for view, camera in enumerate(cameras):
        points = _points(camera, distance)
        weights = lenses.seen(points) * _angle_weight(points, positions, view)
        near = np.linalg.norm(points - positions[view], axis=1)
        far = np.linalg.norm(points[None] - positions[:, None], axis=2)
        weights *= np.minimum(near / far, far / near)
        scores = weights.mean(1)
        scores[view] = 0.0
        chosen[view] = _greedy(scores, positions, points.mean(0), count)
    return chosen


class _Lenses:
    """Which points each camera has in its frame: `Camera.sees`, of all cameras in one call."""

    def __init__(self, cameras: Sequence[Camera]) -> None:
        self.poses = np.stack([camera.cam_from_world.double().numpy() for camera in cameras])
        self.focal = np.stack([camera.focal_px.double().numpy() for camera in cameras])
        self.centre = np.stack([camera.centre_px.double().numpy() for camera in cameras])
        self.size = np.array([[camera.width, camera.height] for camera in cameras], np.float64)

    def seen(self, points: Float64[np.ndarray, "p 3"]) -> Float64[np.ndarray, "v p"]:
        local = np.einsum("vij,pj->vpi", self.poses[:, :3, :3], points) + self.poses[:, None, :3, 3]
        depth = np.where(local[..., 2] > 0, local[..., 2], np.inf)
        pixels = local[..., :2] / depth[..., None] * self.focal[:, None] + self.centre[:, None]
        inside = ((pixels > 0) & (pixels < self.size[:, None])).all(-1)
        return (inside & np.isfinite(depth)).astype(np.float64)


def _points(camera: Camera, distance: float) -> Float64[np.ndarray, "p 3"]:
    steps = (np.arange(_GRID) + 0.5) / _GRID
    pixels = np.stack(np.meshgrid(steps * camera.width, steps * camera.height), -1).reshape(-1, 2)
    z = np.repeat(distance * np.array(_DEPTHS), len(pixels))
    return camera.unproject(torch.as_tensor(np.tile(pixels, (len(_DEPTHS), 1))), torch.as_tensor(z)).numpy()


def _angle_weight(
    points: Float64[np.ndarray, "p 3"], positions: Float64[np.ndarray, "v 3"], view: int
) -> Float64[np.ndarray, "v p"]:
    rays = points[None] - positions[:, None]
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    angle = np.arccos(np.clip((rays * rays[view]).sum(-1), -1.0, 1.0))
    width = np.where(angle < _BEST_RAD, _NARROW_RAD, _WIDE_RAD)
    return np.exp(-0.5 * ((angle - _BEST_RAD) / width) ** 2)


def _greedy(
    scores: Float64[np.ndarray, "v"], positions: Float64[np.ndarray, "v 3"], focus: Float64[np.ndarray, "3"], count: int
) -> Int32[np.ndarray, "k"]:
    rays = focus - positions
    rays /= np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-12)
    found = np.full(count, -1, np.int32)
    scores = scores.copy()
    for place in range(count):
        best = int(np.argmax(scores))
        if scores[best] <= 1e-3:
            break
        found[place] = best
        angle = np.arccos(np.clip(rays @ rays[best], -1.0, 1.0))
        scores *= 1.0 - np.exp(-0.5 * (angle / _APART_RAD) ** 2) * 0.7
        scores[best] = 0.0
    return found
