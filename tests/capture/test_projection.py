"""Lens models: against formulas written out on their own, and what the pinhole views made of them must keep."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from goc.capture.decode import pinhole_view
from goc.capture.distortion import looks_of, pinhole_of, sampling_grid
from goc.capture.lens import Lens, equirectangular
from goc.capture.projection import bend
from goc.capture.rasters import coloured, nearest
from goc.capture.source import View

PLAIN = Lens(160, 120, (70.0, 72.0), (79.0, 61.0))
FISHEYE = replace(PLAIN, projection="fisheye", radial=(-0.03, 0.01, 0.002, -0.001))
RAY = np.array([0.3, -0.4, 1.0])  # rho = 0.5
THETA = math.atan(0.5)


def full_opencv(x, y):
    r2 = x * x + y * y
    k1, k2, p1, p2, k3, k4, k5, k6 = -0.1, 0.02, 0.003, -0.002, 0.01, 0.05, -0.02, 0.004
    radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    return x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y


def aria(theta):
    """Six radial coefficients, then shifts at the place found (projectaria_tools, FisheyeRadTanThinPrism)."""
    k = (-0.03, 0.01, 0.002, -0.001, 0.0005, -0.0002)
    p0, p1, s = 0.003, -0.002, (0.004, 0.001, -0.003, 0.002)
    r = theta * (1 + sum(c * theta ** (2 * i + 2) for i, c in enumerate(k)))
    x, y = r * 0.6, r * -0.8
    r2 = x * x + y * y
    dx = (2 * x * x + r2) * p0 + 2 * x * y * p1 + s[0] * r2 + s[1] * r2 * r2
    dy = (2 * y * y + r2) * p1 + 2 * x * y * p0 + s[2] * r2 + s[3] * r2 * r2
    return x + dx, y + dy


def along(radius):
    """The place at a radius, in the direction of RAY."""
    return radius * 0.6, radius * -0.8


OPENCV = dict(radial=(-0.1, 0.02, 0.01), tangential=(0.003, -0.002), denominator=(0.05, -0.02, 0.004))
ARIA = dict(radial=(-0.03, 0.01, 0.002, -0.001, 0.0005, -0.0002), tangential=(-0.002, 0.003), bent_twice=True)


@pytest.mark.parametrize(
    ("lens", "place"),
    [
        (PLAIN, (0.3, -0.4)),
        (replace(PLAIN, **OPENCV), full_opencv(0.3, -0.4)),
        (replace(PLAIN, projection="fisheye"), along(THETA)),
        (FISHEYE, along(THETA * (1 - 0.03 * THETA**2 + 0.01 * THETA**4 + 0.002 * THETA**6 - 0.001 * THETA**8))),
        (replace(PLAIN, projection="fisheye", prism=(0.004, 0.001, -0.003, 0.002), **ARIA), aria(THETA)),
        (replace(PLAIN, projection="fov", shape=(0.9,)), along(math.atan(2 * 0.5 * math.tan(0.45)) / 0.9)),
        (replace(PLAIN, projection="division", shape=(-0.2,)), along(1.0 / (1 + math.sqrt(1 + 0.8 * 0.25)))),
        (
            replace(PLAIN, projection="eucm", shape=(0.6, 1.1)),
            along(0.5 / (0.6 * math.sqrt(1.1 * 0.25 + 1) + 0.4)),
        ),
        (equirectangular(160, 80), (math.atan(0.3), math.atan2(-0.4, math.hypot(0.3, 1.0)))),
    ],
    ids=["pinhole", "full opencv", "fisheye", "opencv fisheye", "aria", "fov", "division", "eucm", "panorama"],
)
def test_a_direction_is_seen_where_the_model_says(lens, place):
    np.testing.assert_allclose(bend(lens, RAY), place, atol=1e-12)
    np.testing.assert_allclose(bend(lens, 7.0 * RAY), place, atol=1e-12)  # length means nothing
    ahead = bend(lens, np.array([0.0, 0.0, 2.0]))
    np.testing.assert_allclose(ahead, [0, 0], atol=1e-12)


def test_the_division_model_is_closed_by_its_own_inverse():
    """Fitzgibbon's model undistorts by 1 / (1 + k r²): bending and straightening again gives the direction."""
    lens = replace(PLAIN, projection="division", shape=(-0.15,))
    rays = np.random.default_rng(0).uniform(-0.8, 0.8, (50, 2))
    bent = bend(lens, np.concatenate([rays, np.ones((50, 1))], 1))
    straight = bent / (1 - 0.15 * (bent**2).sum(1, keepdims=True))
    np.testing.assert_allclose(straight, rays, atol=1e-12)


def test_fisheyes_see_beyond_a_right_angle_and_pinholes_do_not():
    sideways = np.array([[1.0, 0.0, -0.2]])
    assert np.isnan(bend(PLAIN, sideways)).all()
    np.testing.assert_allclose(
        bend(replace(PLAIN, projection="fisheye"), sideways), [[math.atan2(1.0, -0.2), 0.0]], atol=1e-12
    )


@pytest.mark.parametrize(
    "lens", [FISHEYE, replace(PLAIN, projection="fov", shape=(1.0,)), replace(FISHEYE, margin_px=9)]
)
def test_every_pixel_of_the_pinhole_view_is_covered(lens):
    view = pinhole_of(lens)
    source = (sampling_grid(lens).numpy() + 1) / 2 * [lens.width, lens.height]
    assert (source >= lens.margin_px - 1e-3).all()
    assert (source <= np.array([lens.width, lens.height]) - lens.margin_px + 1e-3).all()
    rays = view.rays(range(view.height))
    np.testing.assert_allclose(source, bend(lens, rays) * lens.focal_px + lens.centre_px, atol=1e-3)
    assert view.width > 60 and view.height > 50


def test_a_moderate_fisheye_is_one_view_and_a_wide_one_the_faces_of_a_cube():
    assert list(looks_of(FISHEYE)) == [""]
    wide = Lens(200, 200, (64.0, 64.0), (100.0, 100.0), projection="fisheye", circle_px=100.0)  # 90° to each side
    assert set(looks_of(wide)) == {"front", "left", "right", "up", "down"}
    assert set(looks_of(equirectangular(80, 40))) == {"front", "left", "right", "back", "up", "down"}
    assert list(looks_of(replace(PLAIN, radial=(0.1,)))) == [""]


@pytest.mark.parametrize("face", ["front", "right", "back", "left", "up", "down"])
def test_the_faces_of_a_panorama_show_their_directions(face):
    """A panorama whose colour is its direction: every pixel of a face has its ray's."""
    panorama = equirectangular(256, 128)
    longitude = (np.arange(256) + 0.5 - 128) / panorama.focal_px[0]
    latitude = (np.arange(128)[:, None] + 0.5 - 64) / panorama.focal_px[1]
    x, z = np.sin(longitude) * np.cos(latitude), np.cos(longitude) * np.cos(latitude)
    planes = torch.from_numpy(np.stack([x, np.sin(latitude) + 0 * longitude, z]).astype(np.float32))
    lens = looks_of(panorama)[face]
    view = pinhole_of(lens)
    assert view.width == view.height
    rays = view.rays(range(view.height))
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    expected = rays @ np.reshape(lens.turn, (3, 3)).T
    for found in (coloured(planes, lens, view), nearest(planes, lens, view)):
        assert np.abs(found.permute(1, 2, 0).numpy() - expected).max() < 0.06  # half a pixel is 0.012, a seam two
    forward = {"front": (0, 0, 1), "right": (1, 0, 0), "back": (0, 0, -1), "left": (-1, 0, 0), "up": (0, -1, 0)}
    np.testing.assert_allclose(np.reshape(lens.turn, (3, 3))[:, 2], forward.get(face, (0, 1, 0)))


def test_a_smaller_view_looks_the_same_way(tmp_path):
    view = View(name="a", lens=FISHEYE, world_from_cam=np.eye(4), image=tmp_path / "a.png")
    whole, small = pinhole_view(view, 10_000), pinhole_view(view, 40)
    assert max(small.width, small.height) == 40
    assert small.focal_px[0] / small.width == pytest.approx(whole.focal_px[0] / whole.width)
    grid = sampling_grid(FISHEYE, small)
    assert grid.shape == (small.height, small.width, 2) and grid.abs().max() <= 1
