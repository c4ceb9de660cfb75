"""Holes are filled from around them, and nothing else changes."""

import torch

from goc.geometry.inpaint import filled


def test_known_pixels_stay_and_holes_lie_between_their_surroundings():
    image = torch.rand(13, 21, generator=torch.Generator().manual_seed(0))
    holes = torch.rand(13, 21, generator=torch.Generator().manual_seed(1)) < 0.7
    found = filled(torch.where(holes, torch.nan, image))
    assert torch.equal(found[~holes], image[~holes])
    assert torch.isfinite(found).all()
    assert found.min() >= image.min() and found.max() <= image.max()


def test_a_constant_is_continued():
    image = torch.full((10, 17), torch.nan)
    image[3, 4] = 2.5
    torch.testing.assert_close(filled(image), torch.full((10, 17), 2.5))


def test_an_image_without_values_stays_empty():
    assert torch.isnan(filled(torch.full((5, 4), torch.nan))).all()


def test_a_slope_is_followed_roughly():
    slope = torch.linspace(1.0, 2.0, 32).expand(32, 32).clone()
    holed = slope.clone()
    holed[8:16, 8:16] = torch.nan
    assert (filled(holed) - slope).abs().max() < 0.12
