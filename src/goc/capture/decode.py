"""One view's files → Frame, in layers: the photograph, then depth, ids and normals, each brought onto its raster."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from goc.capture.distortion import Pinhole, pinhole_of
from goc.capture.masks import ids_of
from goc.capture.pixels import Pixels, codes_in, numbers_in, path_of
from goc.capture.rasters import coloured, nearest
from goc.capture.scan import WithScan
from goc.capture.source import IdCodes, Lens, Source, StoredDepthKind, View
from goc.errors import CaptureError
from goc.files import depth_of, picture_size, read_normals, read_picture
from goc.scene import UNLABELLED, Camera, Frame, FrameSource

_SAME_ASPECT = 0.01
_OPAQUE = 128
_MOST_OPAQUE = 0.9
"""Share of a photograph that is opaque, at most, where its background was cut away."""
_LOOKED_AT = 8


def pinhole_view(view: View, max_side_px: int) -> Pinhole:
    """The pinhole view that is decoded.

    Raises:
        CaptureError: the lens's distortion leaves next to nothing of the image.
    """
    whole = pinhole_of(view.lens)
    scale = max_side_px / max(whole.width, whole.height)
    if scale >= 1:
        return whole
    return whole.resized(max(1, round(whole.width * scale)), max(1, round(whole.height * scale)))


def camera_of(view: View, max_side_px: int) -> Camera:
    """The camera of `pinhole_view`; raises what that raises."""
    seen = pinhole_view(view, max_side_px)
    return Camera(
        focal_px=torch.tensor(seen.focal_px),
        centre_px=torch.tensor(seen.centre_px),
        width=seen.width,
        height=seen.height,
        world_from_cam=torch.from_numpy(view.world_from_cam.astype(np.float32)),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Photographs:
    """The lowest layer: photographs, undistorted and scaled to their cameras."""

    views: tuple[View, ...]
    cameras: tuple[Camera, ...]

    def __call__(self, index: int) -> Frame:
        """Decode a photograph, and its mask and transparency.

        Raises:
            FileError: the file is missing or damaged.
            CaptureError: its size contradicts the intrinsics.
        """
        view, camera = self.views[index], self.cameras[index]
        pixels, alpha = photograph(view)
        _check_size(path_of(view.image), pixels.shape[1], pixels.shape[0], view.lens)
        seen = _pinhole(camera)
        image = coloured(torch.from_numpy(pixels).permute(2, 0, 1), view.lens, seen)
        colours = image.permute(1, 2, 0).round().clamp(0, 255).to(torch.uint8).contiguous()
        return Frame(camera=camera, image=colours, valid=_valid(view, alpha, seen))


@dataclass(frozen=True, kw_only=True, eq=False)
class WithDepth:
    """The views of another source, with the depth images that are stored."""

    below: FrameSource
    views: tuple[View, ...]
    units_per_metre: float
    """Of the stored depth, where a view does not say its own."""
    kind: StoredDepthKind = "metric"
    least_confidence: float = 0.0

    def __call__(self, index: int) -> Frame:
        """Decode a depth image.

        Raises:
            FileError: the file is missing or damaged.
            CaptureError: it has another aspect ratio than the photograph.
        """
        frame, view = self.below(index), self.views[index]
        if view.depth is None:
            return frame
        measured = self.kind in ("metric", "distance")
        units = view.depth_units_per_metre or self.units_per_metre
        stored = depth_of(numbers_in(view.depth), units, saturates=measured)
        depth = _registered(view.depth, torch.from_numpy(stored)[None], view.lens, frame, view.depth_lens)[0]
        if measured:
            depth = depth * _z_of_stored(view, frame.camera, self.kind)
        if view.confidence is not None:
            sure = torch.from_numpy(numbers_in(view.confidence).astype(np.float32))[None]
            sure = _registered(view.confidence, sure, view.lens, frame, view.depth_lens)[0]
            depth = torch.where(sure >= self.least_confidence, depth, torch.nan)
        return replace(frame, depth=_where_valid(depth, frame, torch.nan))


@dataclass(frozen=True, kw_only=True, eq=False)
class WithIds:
    """The views of another source, with the ids that are stored."""

    below: FrameSource
    views: tuple[View, ...]
    codes: IdCodes

    def __call__(self, index: int) -> Frame:
        """Decode an id image; raises what `WithDepth` raises."""
        frame, view = self.below(index), self.views[index]
        if view.ids is None:
            return frame
        ids = torch.from_numpy(ids_of(path_of(view.ids), codes_in(view.ids), self.codes)).float()
        registered = _registered(view.ids, ids[None], view.lens, frame, None, outside=float(UNLABELLED))[0]
        return replace(frame, ids=_where_valid(registered, frame, float(UNLABELLED)).to(torch.int16))


@dataclass(frozen=True, kw_only=True, eq=False)
class CutOuts:
    """The views of another source, whose photographs show one thing and are transparent elsewhere: it is id 1."""

    below: FrameSource

    def __call__(self, index: int) -> Frame:
        """One view; raises what the layer below raises."""
        frame = self.below(index)
        shown = torch.ones(frame.image.shape[:2]) if frame.valid is None else frame.valid
        return replace(frame, ids=torch.where(shown > 0, 1, UNLABELLED).to(torch.int16))


@dataclass(frozen=True, kw_only=True, eq=False)
class WithNormals:
    """The views of another source, with the normal images that are stored."""

    below: FrameSource
    views: tuple[View, ...]

    def __call__(self, index: int) -> Frame:
        """Decode a normal image; raises what `WithDepth` raises, and CaptureError where most look away."""
        frame, view = self.below(index), self.views[index]
        if view.normals is None:
            return frame
        return replace(frame, normals=_normals(view.normals, view.lens, frame))


def layers(source: Source, views: tuple[View, ...], cameras: tuple[Camera, ...], kind: StoredDepthKind) -> FrameSource:
    """What decodes a view, a layer for each kind of image that some view has."""
    frames: FrameSource = Photographs(views=views, cameras=cameras)
    if any(view.depth is not None for view in views):
        depth: dict[str, Any] = {"units_per_metre": source.depth_units_per_metre, "kind": kind}
        frames = WithDepth(below=frames, views=views, least_confidence=source.least_confidence, **depth)
    if any(view.ids is not None for view in views):
        frames = WithIds(below=frames, views=views, codes=source.id_codes)
    if any(view.normals is not None for view in views):
        frames = WithNormals(below=frames, views=views)
    if source.scan is not None:
        frames = WithScan(below=frames, scan=source.scan)
    return frames


def are_cut_out(views: Sequence[View]) -> bool:
    """Whether photographs have no background: all have an alpha channel, and those looked at are partly transparent."""
    if not all(isinstance(view.image, Path) and picture_size(view.image).has_alpha for view in views):
        return False
    for view in views[:: -(-len(views) // _LOOKED_AT)]:
        alpha = photograph(view)[1]
        if alpha is None or not 0 < (alpha >= _OPAQUE).mean() < _MOST_OPAQUE:
            return False
    return True


def photograph(view: View) -> tuple[UInt8[np.ndarray, "h w 3"], UInt8[np.ndarray, "h w"] | None]:
    """Colours and alpha as stored, or upright where only that is of the lens's size; raises FileError."""
    if isinstance(view.image, Path):
        return read_picture(view.image, is_turned(view.image, view.lens))
    pixels = view.image.read()
    return np.ascontiguousarray(pixels[..., :3]), np.ascontiguousarray(pixels[..., 3]) if pixels.shape[2] == 4 else None


def is_turned(path: Path, lens: Lens) -> bool:
    """Whether intrinsics and pose refer to the upright image: it has the lens's size, and the stored one has not."""
    size, wanted = picture_size(path), (lens.width, lens.height)
    return size.stored != wanted and size.upright == wanted


def check_shape(path: Path, width: int, height: int, lens: Lens) -> None:
    """Refuse depth, ids or normals whose raster is not the image's, at any resolution.

    Raises:
        CaptureError: another aspect ratio.
    """
    if not math.isclose(width * lens.height, height * lens.width, rel_tol=_SAME_ASPECT):
        raise CaptureError(
            f"{path}: {width} x {height} pixels, another aspect ratio than the image's {lens.width} x {lens.height}. "
            "Depth, ids and normals must be registered to the colour image."
        )


def _check_size(path: Path, width: int, height: int, lens: Lens) -> None:
    if (width, height) != (lens.width, lens.height):
        raise CaptureError(
            f"{path}: {width} x {height} pixels, but its intrinsics are for {lens.width} x {lens.height}. "
            "Scale the image or the intrinsics."
        )


def _pinhole(camera: Camera) -> Pinhole:
    (across, down), (x, y) = camera.focal_px.tolist(), camera.centre_px.tolist()
    return Pinhole((across, down), (x, y), camera.width, camera.height)


def _valid(view: View, alpha: UInt8[np.ndarray, "h w"] | None, seen: Pinhole) -> Bool[Tensor, "h w"] | None:
    """Where the mask and the transparency leave the photograph; None for everywhere."""
    shown = []
    if alpha is not None and (alpha < _OPAQUE).any():
        shown.append(torch.from_numpy(alpha >= _OPAQUE))
    if view.mask is not None:
        mask = codes_in(view.mask) > 0
        check_shape(path_of(view.mask), mask.shape[1], mask.shape[0], view.lens)
        shown.append(torch.from_numpy(mask))
    if not shown:
        return None
    # linear: a pixel counts where all of what it was made of does
    kept = [coloured(part[None].float(), view.lens, seen)[0] > 0.99 for part in shown]
    return torch.stack(kept).all(0)


def _where_valid(values: Float[Tensor, "h w"], frame: Frame, otherwise: float) -> Float[Tensor, "h w"]:
    return values if frame.valid is None else torch.where(frame.valid, values, otherwise)


def _z_of_stored(view: View, camera: Camera, kind: StoredDepthKind) -> Float[Tensor, "h w"] | float:
    """Z along the view's axis of a stored depth of 1, along the lens's axis or along the pixel's ray."""
    if kind == "metric" and view.lens.turn is None:
        return 1.0
    rays = camera.rays()
    if kind == "distance":
        return 1.0 / rays.norm(dim=-1)
    forward = torch.tensor(view.lens.turn, dtype=rays.dtype)[6:]
    along = rays @ forward
    return torch.where(along > 0, 1.0 / along, torch.nan)


def _normals(pixels: Pixels, lens: Lens, frame: Frame) -> Float[Tensor, "h w 3"]:
    """Normals towards the camera; those that look away, at edges, count as none."""
    stored = read_normals(pixels) if isinstance(pixels, Path) else pixels.read()
    normals = _registered(pixels, torch.from_numpy(stored).permute(2, 0, 1), lens, frame).permute(1, 2, 0)
    if lens.turn is not None:
        normals = normals @ torch.tensor(lens.turn, dtype=normals.dtype).view(3, 3)
    towards = (normals * frame.camera.rays()).sum(-1)
    if (towards > 0).sum() > (towards < 0).sum():
        raise CaptureError(
            f"{path_of(pixels)}: most normals look away from the camera. Write them in OpenCV camera axes (x right, "
            "y down, z forward): from OpenGL axes, negate y and z."
        )
    known = (towards < 0) if frame.valid is None else (towards < 0) & frame.valid
    return torch.where(known[..., None], normals, torch.nan).contiguous()


def _registered(
    pixels: Pixels,
    values: Float[Tensor, "c H W"],
    lens: Lens,
    frame: Frame,
    own: Lens | None = None,
    outside: float = math.nan,
) -> Float[Tensor, "c h w"]:
    """Bring depth, ids or normals onto the camera's raster without mixing neighbours."""
    if own is None:
        check_shape(path_of(pixels), values.shape[2], values.shape[1], lens)
    elif (own.width, own.height) != (values.shape[2], values.shape[1]):
        own = own.resized(values.shape[2], values.shape[1])
    return nearest(values, own or lens, _pinhole(frame.camera), outside).contiguous()
