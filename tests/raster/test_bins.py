"""Tiles and blocks that a splat touches, against geometry: a round splat on the camera's axis is a known disc."""

import math

import pytest
import torch

from cameras import pinhole
from goc import _native
from goc.geometry.native_camera import native_camera

WIDTH, HEIGHT, FOCAL, DEPTH = 45, 37, 60.0, 2.0
"""Neither whole tiles nor whole blocks."""


def touched(centre: tuple[float, float], sigma_px: float, opacity: float) -> tuple[int, int]:
    """Records and blocks of a splat that is seen at `centre`."""
    splats = _native.Splats(
        torch.tensor([[0.0, 0.0, DEPTH]]),
        torch.tensor([[1.0, 0.0, 0.0, 0.0]]),
        torch.full((1, 3), math.log(sigma_px * DEPTH / FOCAL)),
        torch.tensor([math.log(opacity / (1 - opacity))]),
    )
    raster = _native.Raster()
    view = native_camera(pinhole(FOCAL, (WIDTH, HEIGHT), centre))
    images, alpha = [torch.zeros(1, HEIGHT, WIDTH)], torch.zeros(HEIGHT, WIDTH)
    raster.forward(splats, _native.Channels(torch.ones(1, 1)), view, images, alpha)
    return raster.records, raster.blocks


def expected(centre: tuple[float, float], sigma_px: float, opacity: float) -> tuple[int, int] | None:
    """The same, block by block of the image's whole tiles; None where one is a matter of rounding."""
    radius = math.sqrt(2 * (sigma_px**2 + _native.DILATION) * math.log(255 * opacity))
    blocks, tiles = 0, set()
    for y in range(math.ceil(HEIGHT / 16) * 4):
        for x in range(math.ceil(WIDTH / 16) * 4):
            # From the disc's centre to the pixel centres of the block.
            away = [max(4 * b + 0.5 - c, c - 4 * b - 3.5, 0.0) for b, c in zip((x, y), centre, strict=True)]
            if abs(math.hypot(*away) - radius) < 1e-3:
                return None
            if math.hypot(*away) < radius:
                blocks += 1
                tiles.add((x // 4, y // 4))
    return len(tiles), blocks


@pytest.mark.parametrize("sigma_px", [0.3, 1.1, 2.0, 6.0, 40.0])
@pytest.mark.parametrize("opacity", [0.02, 0.8])
def test_touched_blocks_are_those_within_reach(sigma_px, opacity):
    generator = torch.Generator().manual_seed(0)
    # Further out the projection is held within 0.15 of the image's size, and discs become ellipses.
    places = (torch.rand(300, 2, generator=generator) * 1.28 - 0.14) * torch.tensor([WIDTH, HEIGHT])
    compared, seen = 0, 0
    for centre in map(tuple, places.tolist()):
        if (wanted := expected(centre, sigma_px, opacity)) is not None:
            assert touched(centre, sigma_px, opacity) == wanted, centre
            compared, seen = compared + 1, seen + (wanted[1] > 0)
    assert compared > 250 and seen > 80


def test_splats_at_one_depth_blend_in_their_order():
    """Few or many in a tile: two sorts, both stable."""
    for count in (5, 500):
        splats = _native.Splats(
            torch.tensor([[0.0, 0.0, DEPTH]]).expand(count, 3).contiguous(),
            torch.tensor([[1.0, 0.0, 0.0, 0.0]]).expand(count, 4).contiguous(),
            torch.full((count, 3), math.log(8 * DEPTH / FOCAL)),
            torch.full((count,), -1.0),
        )
        image, alpha = torch.zeros(1, 16, 16), torch.zeros(16, 16)
        view = native_camera(pinhole(FOCAL, (16, 16)))
        _native.Raster().forward(splats, _native.Channels(torch.arange(count)[:, None].float()), view, [image], alpha)
        share = torch.sigmoid(torch.tensor(-1.0)) * math.exp(-0.25 / (64 + _native.DILATION))  # at (8.5, 8.5)
        through = (1 - share) ** torch.arange(count + 1)
        weights = torch.where(through[1:] >= _native.MIN_TRANSMITTANCE, share * through[:-1], 0.0)
        torch.testing.assert_close(image[0, 8, 8], (weights * torch.arange(count)).sum(), rtol=1e-4, atol=1e-4)
