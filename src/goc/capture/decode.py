"""One view's files → Frame: read, check sizes, undistort, scale down."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int16, UInt8
from torch import Tensor
from torch.nn import functional as F  # noqa: N812

from goc.capture.distortion import kept_box, sampling_grid
from goc.capture.source import IdCodes, Lens, View
from goc.errors import CaptureError
from goc.files import read_depth, read_ids, read_image, read_normals
from goc.geometry.rays import pixel_rays
from goc.scene import ROOM, UNLABELLED, Camera, Frame

_SAME_ASPECT = 0.01


@dataclass(frozen=True, kw_only=True)
class Decoder:
    """What all views of a capture have in common."""

    depth_unit: float
    id_codes: IdCodes
    max_side_px: int

    def camera(self, view: View) -> Camera:
        """The pinhole camera that the decoded view has."""
        left, top, right, bottom = kept_box(view.lens)
        camera = Camera(
            focal_px=torch.tensor(view.lens.focal_px),
            centre_px=torch.tensor([view.lens.centre_px[0] - left, view.lens.centre_px[1] - top]),
            width=right - left,
            height=bottom - top,
            world_from_cam=torch.from_numpy(view.world_from_cam.astype(np.float32)),
        )
        scale = self.max_side_px / max(camera.width, camera.height)
        if scale >= 1:
            return camera
        return camera.resized(max(1, round(camera.width * scale)), max(1, round(camera.height * scale)))

    def frame(self, view: View, camera: Camera) -> Frame:
        """Decode a view into what `camera` sees.

        Raises:
            FileError: a file is missing or damaged.
            CaptureError: an image's size contradicts the intrinsics.
        """
        image = torch.from_numpy(read_image(view.image))
        _check_size(view.image, image.shape[1], image.shape[0], view.lens)
        depth = None if view.depth is None else self._depth(view.depth, view.lens, camera)
        ids = None if view.ids is None else self._ids(view.ids, view.lens, camera)
        normals = None if view.normals is None else _normals(view.normals, view.lens, camera)
        return Frame(camera=camera, image=_colour(image, view.lens, camera), depth=depth, normals=normals, ids=ids)

    def _depth(self, path: Path, lens: Lens, camera: Camera) -> Float[Tensor, "h w"]:
        return _nearest(path, torch.from_numpy(read_depth(path, self.depth_unit))[None], lens, camera)[0]

    def _ids(self, path: Path, lens: Lens, camera: Camera) -> Int16[Tensor, "h w"]:
        stored = read_ids(path)
        ids = stored.copy()
        ids[stored == self.id_codes.background] = ROOM
        if self.id_codes.unknown is not None:
            ids[stored == self.id_codes.unknown] = UNLABELLED
        if self.id_codes.values:
            ids[~np.isin(stored, self.id_codes.values)] = UNLABELLED
        return _nearest(path, torch.from_numpy(ids).float()[None], lens, camera)[0].to(torch.int16)


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
    left, top, right, bottom = kept_box(lens)
    if lens.is_pinhole and (camera.width, camera.height) == (right - left, bottom - top):
        return image
    planes = image.permute(2, 0, 1)[None].float()
    if not lens.is_pinhole:
        grid = sampling_grid(lens)[None]
        planes = F.grid_sample(planes, grid, mode="bilinear", padding_mode="border", align_corners=False)
    if planes.shape[2:] != (camera.height, camera.width):
        size = (camera.height, camera.width)
        planes = F.interpolate(planes, size=size, mode="bilinear", antialias=True, align_corners=False)
    return planes[0].permute(1, 2, 0).round().clamp(0, 255).to(torch.uint8).contiguous()


def _normals(path: Path, lens: Lens, camera: Camera) -> Float[Tensor, "h w 3"]:
    """Normals towards the camera; those that look away, at edges, count as none. Undistortion turns no axis."""
    stored = torch.from_numpy(read_normals(path)).permute(2, 0, 1)
    normals = _nearest(path, stored, lens, camera).permute(1, 2, 0)
    towards = (normals * pixel_rays(camera)).sum(-1)
    if (towards > 0).sum() > (towards < 0).sum():
        raise CaptureError(
            f"{path}: most normals look away from the camera. Write them in OpenCV camera axes (x right, y down, "
            "z forward): from OpenGL axes, negate y and z."
        )
    return torch.where((towards < 0)[..., None], normals, torch.nan).contiguous()


def _nearest(path: Path, values: Float[Tensor, "c H W"], lens: Lens, camera: Camera) -> Float[Tensor, "c h w"]:
    """Bring depth, ids or normals onto the camera's raster without mixing neighbours."""
    check_shape(path, values.shape[2], values.shape[1], lens)
    planes = values[None]
    if not lens.is_pinhole:
        grid = sampling_grid(lens)[None]
        planes = F.grid_sample(planes, grid, mode="nearest", padding_mode="border", align_corners=False)
    if planes.shape[2:] != (camera.height, camera.width):
        planes = F.interpolate(planes, size=(camera.height, camera.width), mode="nearest-exact")
    return planes[0].contiguous()
