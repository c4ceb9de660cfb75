"""The slow, obvious rasteriser: every splat on every pixel, float64, plain PyTorch, gradients by autograd."""

import torch
from torch import Tensor

from goc import _native
from goc.scene import Camera, Gaussians


def rotation_matrices(quats: Tensor) -> Tensor:
    w, x, y, z = torch.nn.functional.normalize(quats, dim=-1).unbind(-1)
    rows = [
        torch.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
        torch.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1),
        torch.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1),
    ]
    return torch.stack(rows, -2)


def project(gaussians: Gaussians, camera: Camera) -> tuple[Tensor, Tensor, Tensor]:
    """Image positions (n 2), image covariances (n 2 2) and depths (n)."""
    view = camera.cam_from_world.double()
    centres = gaussians.means @ view[:3, :3].T + view[:3, 3]
    z = centres[:, 2]
    focal, middle = camera.focal_px.double(), camera.centre_px.double()
    size = torch.tensor([camera.width, camera.height], dtype=torch.float64)
    slack = 0.3 * 0.5 * size / focal
    slopes = torch.clamp(centres[:, :2] / z[:, None], -middle / focal - slack, (size - middle) / focal + slack)
    zero = torch.zeros_like(z)
    jacobian = torch.stack(
        [
            torch.stack([focal[0] / z, zero, -focal[0] * slopes[:, 0] / z], -1),
            torch.stack([zero, focal[1] / z, -focal[1] * slopes[:, 1] / z], -1),
        ],
        -2,
    )
    axes = rotation_matrices(gaussians.quats) * gaussians.log_scales.exp()[:, None, :]
    projected = jacobian @ view[:3, :3] @ axes
    covariances = projected @ projected.transpose(1, 2) + _native.DILATION * torch.eye(2, dtype=torch.float64)
    return centres[:, :2] / z[:, None] * focal + middle, covariances, z


def rasterize(gaussians: Gaussians, camera: Camera, channels: Tensor) -> tuple[Tensor, Tensor]:
    """image (h w c) and alpha (h w) by the definition, Eq. (1)."""
    positions, covariances, z = project(gaussians, camera)
    inverse = torch.linalg.inv(covariances)
    rows, columns = torch.meshgrid(torch.arange(camera.height), torch.arange(camera.width), indexing="ij")
    pixels = torch.stack([columns, rows], -1).double() + 0.5
    image = torch.zeros(camera.height, camera.width, channels.shape[1], dtype=torch.float64)
    alpha = torch.zeros(camera.height, camera.width, dtype=torch.float64)
    transmittance = torch.ones_like(alpha)
    opacities = gaussians.opacity_logits.sigmoid()
    for i in torch.argsort(z, stable=True).tolist():
        if z[i] <= _native.NEAR:
            continue
        offset = pixels - positions[i]
        density = torch.exp(-0.5 * torch.einsum("hwi,ij,hwj->hw", offset, inverse[i], offset))
        a = torch.clamp(opacities[i] * density, max=_native.MAX_ALPHA)
        a = torch.where(a >= _native.MIN_ALPHA, a, torch.zeros_like(a))
        left = transmittance * (1 - a)
        weight = torch.where(left >= _native.MIN_TRANSMITTANCE, a * transmittance, torch.zeros_like(a))
        transmittance = torch.where(left >= _native.MIN_TRANSMITTANCE, left, torch.zeros_like(a))
        image = image + weight[..., None] * channels[i]
        alpha = alpha + weight
    return image, alpha
