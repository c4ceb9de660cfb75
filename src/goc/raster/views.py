"""Several views of one image size, drawn in one call, and the channels that a training step draws into them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from goc import _native
from goc.geometry.harmonics import BAND_0, harmonics
from goc.geometry.native_camera import native_camera
from goc.geometry.rotations import rotated
from goc.scene.camera import Camera
from goc.scene.gaussians import Gaussians

COMPILED_WIDTHS = (1, 2, 3, 4, 5, 8, 9, 16, 17, 32)
"""Numbers of channels that gsplat 1.5.3 has kernels for. For others it copies all channels to pad them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Views:
    """Cameras of one image size, with their matrices stacked on the device that draws."""

    cameras: tuple[Camera, ...]
    """The given cameras, on the device where they were."""
    cam_from_world: Float[Tensor, "v 4 4"]
    intrinsics: Float[Tensor, "v 3 3"]
    """K: pixel (0, 0) is centred at (0.5, 0.5)."""

    @cached_property
    def native_cameras(self) -> tuple[_native.Camera, ...]:
        """Each camera as the kernels take it; made once, since a training step asks for it several times."""
        return tuple(native_camera(camera) for camera in self.cameras)

    @property
    def focal_px(self) -> Float[Tensor, "v 2"]:
        """Focal lengths of each view, pixels."""
        return self.intrinsics.diagonal(dim1=1, dim2=2)[:, :2]

    @property
    def centre_px(self) -> Float[Tensor, "v 2"]:
        """Principal point of each view, pixels."""
        return self.intrinsics[:, :2, 2]

    @property
    def width(self) -> int:
        """Width of every image, pixels."""
        return self.cameras[0].width

    @property
    def height(self) -> int:
        """Height of every image, pixels."""
        return self.cameras[0].height

    @property
    def eyes(self) -> Float[Tensor, "v 3"]:
        """Centre of projection of each view, world."""
        return -torch.einsum("vji,vj->vi", self.cam_from_world[:, :3, :3], self.cam_from_world[:, :3, 3])

    @property
    def rays(self) -> tuple[Float[Tensor, "v 1 w"], Float[Tensor, "v h 1"]]:
        """Rays (x, y, 1) = K⁻¹p of pixel centres, camera axes, as x of each column and y of each row."""
        device = self.intrinsics.device
        focal, centre = self.focal_px[:, None], self.centre_px[:, None]
        x = (torch.arange(self.width, device=device) + 0.5 - centre[..., 0]) / focal[..., 0]
        y = (torch.arange(self.height, device=device) + 0.5 - centre[..., 1]) / focal[..., 1]
        return x[:, None, :], y[:, :, None]


def views_of(cameras: Sequence[Camera], device: torch.device) -> Views:
    """Stack cameras of one image size on a device."""
    focal = torch.stack([camera.focal_px for camera in cameras])
    intrinsics = torch.diag_embed(torch.nn.functional.pad(focal, (0, 1), value=1.0))
    intrinsics[:, :2, 2] = torch.stack([camera.centre_px for camera in cameras])
    return Views(
        cameras=tuple(cameras),
        cam_from_world=torch.stack([camera.cam_from_world for camera in cameras]).to(device),
        intrinsics=intrinsics.to(device),
    )


def joined_views(parts: Sequence[Views]) -> Views:
    """Join the views of all parts in order; they have to be on one device."""
    if len(parts) == 1:
        return parts[0]
    return Views(
        cameras=tuple(camera for part in parts for camera in part.cameras),
        cam_from_world=torch.cat([part.cam_from_world for part in parts]),
        intrinsics=torch.cat([part.intrinsics for part in parts]),
    )


def compiled_width(count: int) -> int:
    """Smallest number of channels, at least `count`, that gsplat has a kernel for; above 32, a multiple of 32."""
    return next((width for width in COMPILED_WIDTHS if width >= count), -(-count // 32) * 32)


def view_channels(gaussians: Gaussians, views: Views, planes: bool) -> Float[Tensor, "v n c"]:
    """Channels of each splat for each view: colour (3), plane (4) or z of the centre (1), features; differentiable.

    `colours_towards`, `plane_channels` and `centre_depths` do the same for one camera. Zeros follow up to
    `compiled_width`, so that gsplat need not copy all channels to pad them.
    """
    rotations, shifts = views.cam_from_world[:, :3, :3], views.cam_from_world[:, :3, 3]
    centres = torch.einsum("vij,nj->vni", rotations, gaussians.means) + shifts[:, None]
    parts = [_colours(gaussians, views.eyes)]
    if planes:
        axes = torch.arange(3, device=centres.device)
        thinnest = (gaussians.log_scales.argmin(-1, keepdim=True) == axes).to(centres.dtype)
        normals = torch.einsum("vij,nj->vni", rotations, rotated(gaussians.quats, thinnest))
        distances = (normals * centres).sum(-1, keepdim=True)
        # The normal of a plane in front of the camera that faces it has n·centre < 0.
        sign = torch.where(distances > 0, -1.0, 1.0)
        parts += [normals * sign, distances * sign]
    else:
        parts.append(centres[..., 2:])
    if gaussians.identity is not None:
        parts.append(gaussians.identity.expand(len(centres), -1, -1))
    count = sum(part.shape[-1] for part in parts)
    parts.append(centres.new_zeros(1, 1, 1).expand(*centres.shape[:2], compiled_width(count) - count))
    return torch.cat(parts, -1)


def _colours(gaussians: Gaussians, eyes: Float[Tensor, "v 3"]) -> Float[Tensor, "v n 3"]:
    """Colour seen from each view, max(0, 0.5 + Σ sh·Y); no gradient reaches the means."""
    if gaussians.sh_degree == 0:
        return (0.5 + BAND_0 * gaussians.sh[:, 0]).clamp_min(0.0).expand(len(eyes), -1, -1)
    directions = torch.nn.functional.normalize(gaussians.means.detach() - eyes[:, None], dim=-1)
    basis = harmonics(directions.reshape(-1, 3), gaussians.sh_degree).view(*directions.shape[:2], -1)
    return (0.5 + torch.einsum("vnk,nkc->vnc", basis, gaussians.sh)).clamp_min(0.0)
