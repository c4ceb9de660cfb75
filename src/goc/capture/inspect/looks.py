"""One look at every view: what is kept of it is small, so that 200 views can be compared with each other."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float64, Int16, UInt8
from torch.nn import functional as F  # noqa: N812

from goc.capture.source import Source
from goc.events import Listener, Progress
from goc.scene import ROOM, Camera, Capture, Frame

_THUMB_PX, _SMALL_PX = 176, 112
_PIXELS = 200_000_000
"""Stored pixels that are decoded: five seconds or so."""
_THREADS = 2


@dataclass(frozen=True, eq=False)
class Look:
    """What is kept of a view."""

    index: int
    name: str
    camera: Camera
    thumbnail: UInt8[np.ndarray, "h w 3"]
    sharpness: float
    """Energy of the Laplacian over that of the gradient: how much of the detail is as fine as a pixel."""
    areas: dict[int, float]
    """Share of the image that each object covers."""
    small: Camera
    """The camera of the arrays below."""
    grey: Float64[np.ndarray, "r c"]
    """Linear-ish brightness, 0 to 1."""
    depth: Float64[np.ndarray, "r c"] | None
    ids: Int16[np.ndarray, "r c"] | None


def look_at(source: Source, capture: Capture, notify: Listener) -> tuple[Look, ...]:
    """Look at all views, or at as many, evenly spread, as can be decoded in a few seconds."""
    pixels = float(np.mean([view.lens.width * view.lens.height for view in source.views]))
    number = int(np.clip(_PIXELS / max(pixels, 1.0), 12, len(capture)))
    rows = np.unique(np.linspace(0, len(capture) - 1, number).round().astype(int)).tolist()
    looks: list[Look] = []
    with ThreadPoolExecutor(_THREADS) as pool:
        for look in pool.map(lambda row: _look(row, capture), rows):
            looks.append(look)
            notify(Progress(stage="inspect", done=len(looks), total=len(rows)))
    return tuple(looks)


def _look(index: int, capture: Capture) -> Look:
    frame = capture[index]
    small = _scaled(frame.camera, _SMALL_PX)
    grey = frame.image.float().mean(2) / 255
    return Look(
        index=index,
        name=capture.view_names[index],
        camera=frame.camera,
        thumbnail=_thumbnail(frame),
        sharpness=_sharpness(grey),
        areas=_areas(frame),
        small=small,
        grey=_averaged(grey, small).double().numpy() ** 2.2,
        depth=None if frame.depth is None else _picked(frame.depth, small).double().numpy(),
        ids=None if frame.ids is None else _picked(frame.ids, small).numpy(),
    )


def _scaled(camera: Camera, side: int) -> Camera:
    scale = min(1.0, side / max(camera.width, camera.height))
    return camera.resized(max(1, round(camera.width * scale)), max(1, round(camera.height * scale))).double()


def _thumbnail(frame: Frame) -> UInt8[np.ndarray, "h w 3"]:
    small = _scaled(frame.camera, _THUMB_PX)
    planes = frame.image.permute(2, 0, 1)[None].float()
    shown = F.interpolate(planes, (small.height, small.width), mode="bilinear", antialias=True)[0]
    return shown.permute(1, 2, 0).round().clamp(0, 255).to(torch.uint8).numpy()


def _averaged(plane: torch.Tensor, small: Camera) -> torch.Tensor:
    return F.interpolate(plane[None, None], (small.height, small.width), mode="area")[0, 0]


def _picked(plane: torch.Tensor, small: Camera) -> torch.Tensor:
    """The pixel in the middle of each cell: neighbours are not mixed."""
    rows = ((torch.arange(small.height) + 0.5) * plane.shape[0] / small.height).long()
    columns = ((torch.arange(small.width) + 0.5) * plane.shape[1] / small.width).long()
    return plane[rows][:, columns]


def _sharpness(grey: torch.Tensor) -> float:
    across, down = grey[1:-1, 2:] - grey[1:-1, :-2], grey[2:, 1:-1] - grey[:-2, 1:-1]
    bent = grey[1:-1, 2:] + grey[1:-1, :-2] + grey[2:, 1:-1] + grey[:-2, 1:-1] - 4 * grey[1:-1, 1:-1]
    return float(bent.square().mean() / (across.square() + down.square()).mean().clamp(min=1e-9))


def _areas(frame: Frame) -> dict[int, float]:
    if frame.ids is None:
        return {}
    numbers, counts = np.unique(frame.ids.numpy(), return_counts=True)
    return {int(n): float(c) / frame.ids.numel() for n, c in zip(numbers, counts, strict=True) if n > ROOM}


def neighbours(looks: Sequence[Look], row: int, reach: int) -> list[Look]:
    """Views taken shortly before and after one."""
    return [look for at, look in enumerate(looks) if 0 < abs(at - row) <= reach]
