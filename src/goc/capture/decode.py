"""One view's files → Frame, in layers: the photograph, then depth, ids and normals, each brought onto its raster."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int16, UInt8
from torch import Tensor

from goc.capture.distortion import kept_box
from goc.capture.rasters import resized, undistorted
from goc.capture.source import IdCodes, Lens, View
from goc.errors import CaptureError
from goc.files import read_depth, read_ids, read_image, read_normals
from goc.scene import ROOM, UNLABELLED, Camera, Frame, FrameSource

_SAME_ASPECT = 0.01


def camera_of(view: View, max_side_px: int) -> Camera:
    """The pinhole camera that the decoded view has.

    Raises:
        CaptureError: the lens's distortion leaves next to nothing of the image.
    """
    left, top, right, bottom = kept_box(view.lens)
    camera = Camera(
        focal_px=torch.tensor(view.lens.focal_px),
        centre_px=torch.tensor([view.lens.centre_px[0] - left, view.lens.centre_px[1] - top]),
        width=right - left,
        height=bottom - top,
        world_from_cam=torch.from_numpy(view.world_from_cam.astype(np.float32)),
    )
    scale = max_side_px / max(camera.width, camera.height)
    if scale >= 1:
        return camera
    return camera.resized(max(1, round(camera.width * scale)), max(1, round(camera.height * scale)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Photographs:
    """The lowest layer: photographs, undistorted and scaled to their cameras."""

    views: tuple[View, ...]
    cameras: tuple[Camera, ...]

    def __call__(self, index: int) -> Frame:
        """Decode a photograph.

        Raises:
            FileError: the file is missing or damaged.
            CaptureError: its size contradicts the intrinsics.
        """
        view, camera = self.views[index], self.cameras[index]
        image = torch.from_numpy(read_image(view.image))
        _check_size(view.image, image.shape[1], image.shape[0], view.lens)
        return Frame(camera=camera, image=_colour(image, view.lens, camera))


@dataclass(frozen=True, kw_only=True, eq=False)
class WithDepth:
    """The views of another source, with the depth images that are stored."""

    below: FrameSource
    views: tuple[View, ...]
    units_per_metre: float
    """Of the stored depth."""

    def __call__(self, index: int) -> Frame:
        """Decode a depth image.

        Raises:
            FileError: the file is missing or damaged.
            CaptureError: it has another aspect ratio than the photograph.
        """
        frame, view = self.below(index), self.views[index]
        if view.depth is None:
            return frame
        stored = torch.from_numpy(read_depth(view.depth, self.units_per_metre))
        return replace(frame, depth=_nearest(view.depth, stored[None], view.lens, frame.camera)[0])


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
        ids = torch.from_numpy(self._meant(read_ids(view.ids))).float()
        return replace(frame, ids=_nearest(view.ids, ids[None], view.lens, frame.camera)[0].to(torch.int16))

    def _meant(self, stored: Int16[np.ndarray, "h w"]) -> Int16[np.ndarray, "h w"]:
        ids = stored.copy()
        ids[stored == self.codes.background] = ROOM
        if self.codes.unknown is not None:
            ids[stored == self.codes.unknown] = UNLABELLED
        if self.codes.values:
            ids[~np.isin(stored, self.codes.values)] = UNLABELLED
        return ids


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
        return replace(frame, normals=_normals(view.normals, view.lens, frame.camera))


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


def _colour(image: UInt8[Tensor, "H W 3"], lens: Lens, camera: Camera) -> UInt8[Tensor, "h w 3"]:
    if lens.is_pinhole and (camera.height, camera.width) == tuple(image.shape[:2]):
        return image
    planes = resized(undistorted(image.permute(2, 0, 1).float(), lens, "bilinear"), camera, "bilinear")
    return planes.permute(1, 2, 0).round().clamp(0, 255).to(torch.uint8).contiguous()


def _normals(path: Path, lens: Lens, camera: Camera) -> Float[Tensor, "h w 3"]:
    """Normals towards the camera; those that look away, at edges, count as none. Undistortion turns no axis."""
    stored = torch.from_numpy(read_normals(path)).permute(2, 0, 1)
    normals = _nearest(path, stored, lens, camera).permute(1, 2, 0)
    towards = (normals * camera.rays()).sum(-1)
    if (towards > 0).sum() > (towards < 0).sum():
        raise CaptureError(
            f"{path}: most normals look away from the camera. Write them in OpenCV camera axes (x right, y down, "
            "z forward): from OpenGL axes, negate y and z."
        )
    return torch.where((towards < 0)[..., None], normals, torch.nan).contiguous()


def _nearest(path: Path, values: Float[Tensor, "c H W"], lens: Lens, camera: Camera) -> Float[Tensor, "c h w"]:
    """Bring depth, ids or normals onto the camera's raster without mixing neighbours."""
    check_shape(path, values.shape[2], values.shape[1], lens)
    return resized(undistorted(values, lens, "nearest"), camera, "nearest").contiguous()
