"""Pictures of an inspected capture: a contact sheet, and its cameras around the points that they see."""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float64, UInt8
from PIL import Image, ImageDraw

from goc.capture.inspect import Inspected
from goc.capture.inspect.looks import Look
from goc.report.canvas import ALARM, FAINT, Canvas

_COLUMNS, _MOST, _CELL, _GAP = 8, 48, 148, 8
_SIDE = 620
_PAPER, _CAMERA = (250, 250, 248), (38, 92, 140)


def contact_sheet(found: Inspected) -> UInt8[np.ndarray, "h w 3"]:
    """Up to 48 views, evenly spread, in order; damaged ones have an orange bar and say what it is."""
    damaged: dict[str, str] = {}
    for one in found.inspection.damage:
        damaged[one.view] = f"{damaged[one.view]}, {one.what}" if one.view in damaged else one.what
    rows = np.unique(np.linspace(0, len(found.looks) - 1, min(_MOST, len(found.looks))).round().astype(int))
    looks = [found.looks[row] for row in rows]
    down = -(-len(looks) // _COLUMNS)
    height = round(_CELL * max(look.thumbnail.shape[0] / look.thumbnail.shape[1] for look in looks))
    page = Canvas(_COLUMNS * (_CELL + _GAP) + _GAP, down * (height + 20 + _GAP) + _GAP)
    for place, look in enumerate(looks):
        x = _GAP + (place % _COLUMNS) * (_CELL + _GAP)
        y = _GAP + (place // _COLUMNS) * (height + 20 + _GAP)
        page.picture(look.thumbnail, x, y, _CELL, height)
        name = look.name.rsplit("/", 1)[-1]
        words = f"{name}: {damaged[look.name]}" if look.name in damaged else name
        page.text(words, x, y + height + 3, 12, _CELL, ALARM if look.name in damaged else FAINT)
    return page.pixels()


def camera_picture(found: Inspected) -> UInt8[np.ndarray, "h w 3"]:
    """Cameras and points from above and from one side; up is that of the cameras."""
    points, colours = _points(found)
    up = np.array(found.inspection.up)
    across = np.cross(up, np.eye(3)[int(np.abs(up).argmin())])
    across /= np.linalg.norm(across)
    away = np.cross(up, across)
    odd = {one.view for one in found.inspection.damage if one.what == "pose"}
    from_above = _drawn(found, points, colours, np.stack([across, -away, up]), odd)
    from_side = _drawn(found, points, colours, np.stack([across, -up, away]), odd)
    return np.concatenate([from_above, from_side], axis=1)


def _points(found: Inspected) -> tuple[Float64[np.ndarray, "p 3"], UInt8[np.ndarray, "p 3"]]:
    """Points that depth gives, or the seed points."""
    looks = [look for look in found.looks if look.depth is not None]
    if found.capture.has_metric_depth and looks:
        parts = [_points_of(look) for look in looks[:: max(1, len(looks) // 60)]]
        return np.concatenate([p for p, _ in parts]), np.concatenate([c for _, c in parts])
    seeds = found.capture.points
    if seeds is None:
        return np.zeros((0, 3)), np.zeros((0, 3), np.uint8)
    return seeds.positions.astype(np.float64), seeds.colours


def _points_of(look: Look) -> tuple[Float64[np.ndarray, "p 3"], UInt8[np.ndarray, "p 3"]]:
    assert look.depth is not None
    world = look.small.unproject_depth(torch.from_numpy(look.depth)).numpy()[::2, ::2]
    picture = Image.fromarray(look.thumbnail).resize((look.small.width, look.small.height))
    known = np.isfinite(world).all(-1)
    return world[known], np.array(picture)[::2, ::2][known]


def _drawn(
    found: Inspected,
    points: Float64[np.ndarray, "p 3"],
    colours: UInt8[np.ndarray, "p 3"],
    axes: Float64[np.ndarray, "3 3"],
    odd: set[str],
) -> UInt8[np.ndarray, "h w 3"]:
    """Orthographic: rows of `axes` are right, down and towards the eye; nearer points cover others."""
    cameras = found.capture.cameras
    positions = np.stack([camera.position.double().numpy() for camera in cameras])
    low, high = _extent(np.concatenate([points, positions]) @ axes.T)
    scale = (_SIDE - 40) / max(float((high - low).max()), 1e-9)
    shift = (_SIDE - (low + high)[:2] * scale) / 2

    def placed(world: np.ndarray) -> np.ndarray:
        return (world @ axes.T)[..., :2] * scale + shift

    page = np.full((_SIDE, _SIDE, 3), _PAPER, np.uint8)
    order = np.argsort(points @ axes[2]) if len(points) else np.zeros(0, int)
    order = order[_below_ceiling(points @ axes[2], order)] if len(order) else order
    at = placed(points[order]).round().astype(int)
    inside = ((at >= 0) & (at < _SIDE)).all(1)
    page[at[inside, 1], at[inside, 0]] = colours[order][inside]
    image = Image.fromarray(page)
    pen = ImageDraw.Draw(image)
    size = 0.05 * float((high - low).max())
    for name, camera in zip(found.capture.view_names, cameras, strict=True):
        colour = ALARM if name in odd else _CAMERA
        corners = [placed(corner) for corner in _frustum(camera.world_from_cam.double().numpy(), size)]
        for corner in corners[1:]:
            pen.line([*corners[0], *corner], fill=colour, width=1)
        pen.line([tuple(corner) for corner in (*corners[1:], corners[1])], fill=colour, width=1)
    return np.array(image)


def _below_ceiling(height: Float64[np.ndarray, "p"], order: np.ndarray) -> np.ndarray:
    """Of points sorted towards the eye, all but the nearest tenth: a ceiling or wall would hide the room."""
    return height[order] < np.quantile(height, 0.9)


def _extent(places: Float64[np.ndarray, "p 3"]) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]:
    low, high = np.quantile(places, [0.005, 0.995], axis=0)
    return low, high


def _frustum(pose: Float64[np.ndarray, "4 4"], size: float) -> Sequence[Float64[np.ndarray, "3"]]:
    """Eye and four corners of a small camera."""
    corners = np.array([[0, 0, 0], [-0.5, -0.4, 0.8], [0.5, -0.4, 0.8], [0.5, 0.4, 0.8], [-0.5, 0.4, 0.8]]) * size
    return list(corners @ pose[:3, :3].T + pose[:3, 3])
