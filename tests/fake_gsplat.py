"""A module that answers as gsplat 1.5.3 does, by the slow rasteriser: for machines without a GPU."""

from types import SimpleNamespace

import torch

from cameras import pinhole
from goc import _native
from goc.scene import Gaussians
from oracles import splatting


def rasterization(
    *, means, quats, scales, opacities, colors, viewmats, Ks, width, height, near_plane, eps2d, packed, channel_chunk
):
    """Shapes and constants are checked as gsplat checks them, or would silently take others."""
    count, views, channels = len(means), len(viewmats), colors.shape[-1]
    assert means.shape == (count, 3) and quats.shape == (count, 4) and scales.shape == (count, 3)
    assert opacities.shape == (count,) and colors.shape == (views, count, channels)
    assert viewmats.shape == (views, 4, 4) and Ks.shape == (views, 3, 3)
    assert (near_plane, eps2d, packed, channel_chunk) == (_native.NEAR, _native.DILATION, False, 32)
    drawn = []
    for view, matrix, own in zip(viewmats, Ks, colors, strict=True):
        camera = pinhole(matrix.diagonal()[:2], (width, height), matrix[:2, 2], torch.linalg.inv(view))
        splats = Gaussians(
            means=means.double(),
            quats=quats.double(),
            log_scales=scales.double().log(),
            opacity_logits=opacities.double().logit(),
            sh=torch.zeros(count, 1, 3, dtype=torch.float64),
        )
        drawn.append(splatting.rasterize(splats, camera, own.double()))
    image = torch.stack([image for image, _ in drawn]).float()
    return image, torch.stack([alpha for _, alpha in drawn]).float()[..., None], {}


MODULE = SimpleNamespace(rasterization=rasterization, __name__="gsplat")
