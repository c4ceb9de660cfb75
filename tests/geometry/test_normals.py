"""Normals of depth images: closed form on planes, and what noise and edges do."""

import numpy as np
import pytest
import torch

from cameras import pinhole
from goc.geometry.normals import fitted_normals, fitting_radius, normals_from_depth
from oracles import normals as oracle

VIEW = pinhole((60.0, 64.0), centre=(31.0, 25.0))


def plane(normal: torch.Tensor, distance: float) -> torch.Tensor:
    """z depth of the plane normal·x = -distance (it faces the camera when normal·z < 0)."""
    return -distance / (VIEW.rays() @ normal)


@pytest.mark.parametrize("direction", [(0.0, 0.0, -1.0), (0.3, -0.2, -1.0), (-0.4, 0.5, -0.9)])
@pytest.mark.parametrize("radius", [1, 3])
def test_normals_of_a_plane(direction, radius):
    normal = torch.nn.functional.normalize(torch.tensor(direction), dim=0)
    depth = plane(normal, 2.0)
    for normals in (normals_from_depth(depth, VIEW), fitted_normals(depth, VIEW, radius)):
        inner = normals[4:-4, 4:-4]
        assert (inner @ normal).min().item() == pytest.approx(1.0, abs=1e-4)
    assert torch.isnan(normals_from_depth(depth, VIEW)[0]).all()


def test_points_from_depth_lie_on_the_plane():
    normal = torch.nn.functional.normalize(torch.tensor([0.3, -0.2, -1.0]), dim=0)
    points = VIEW.unproject_depth(plane(normal, 2.0))
    assert torch.allclose(points @ normal, torch.full((48, 64), -2.0), atol=1e-5)


def test_fitted_normals_stay_on_one_side_of_an_edge():
    depth = torch.full((48, 64), 2.0)
    depth[:, 32:] = 3.0
    normals = fitted_normals(depth, VIEW, 2)
    known = torch.isfinite(normals).all(-1)
    assert known[4:-4, 4:-4].all()
    assert normals[known][:, 2].max() < -0.999


def test_fitting_radius_grows_with_noise():
    generator = torch.Generator().manual_seed(0)
    noise = torch.randn(48, 64, generator=generator)
    normal = torch.nn.functional.normalize(torch.tensor([0.1, 0.1, -1.0]), dim=0)
    depth = plane(normal, 2.0)
    radii = [fitting_radius(depth + sigma * noise, VIEW) for sigma in (0.0, 0.006, 0.05)]
    assert radii[0] == 1 and radii[-1] == 4 and radii == sorted(radii)
    fitted = fitted_normals(depth + 0.006 * noise, VIEW, radii[1])[5:-5, 5:-5]
    plain = normals_from_depth(depth + 0.006 * noise, VIEW)[5:-5, 5:-5]
    assert (fitted @ normal).nanmean() > (plain @ normal).nanmean()


def test_missing_depth_has_no_normal():
    depth = torch.full((48, 64), torch.nan)
    assert torch.isnan(fitted_normals(depth, VIEW, 2)).all()
    assert fitting_radius(depth, VIEW) == 1


@pytest.mark.parametrize("radius", [1, 3])
def test_fitted_normals_match_the_oracle(radius):
    generator = torch.Generator().manual_seed(radius)
    bumps = 0.02 * torch.randn(48, 64, generator=generator)
    depth = plane(torch.nn.functional.normalize(torch.tensor([0.3, -0.2, -1.0]), dim=0), 2.0) + bumps
    depth[10:14, 20:30] = torch.nan
    depth[30:, 40:] += 1.0
    fast = fitted_normals(depth, VIEW, radius).numpy()
    points = VIEW.unproject_depth(depth).double().numpy()
    for y in range(0, 48, 3):
        for x in range(0, 64, 3):
            expected = oracle.fitted_normal(points, x, y, radius, 0.05)
            if expected is None:
                assert np.isnan(fast[y, x]).all()
            else:
                assert fast[y, x] == pytest.approx(expected, abs=2e-3)
