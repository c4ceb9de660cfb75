"""Slow errors of depth, found by looking from elsewhere: on the box room with a finer texture."""

from dataclasses import replace

import pytest
import torch

import captures
from goc.capture import load_capture
from goc.capture.source import Lens
from goc.events import ignore
from goc.geometry.alignment import CELLS, spread
from goc.geometry.monocular import GRID, ROW, aligned_frame
from goc.priors.bend import bend
from goc.scene import Capture, Frame

LENS = Lens(96, 72, (75.0, 76.0), (47.0, 36.5))
VIEWS = 16


@pytest.fixture(scope="module")
def room(tmp_path_factory) -> Capture:
    """True depth, called affine: k = 1 and b = 0 in every view. Waves of a foot or so on all surfaces."""
    folder = captures.write_nerfstudio(tmp_path_factory.mktemp("bend"), views=VIEWS, lens=LENS)
    capture = load_capture(folder)
    directions = torch.tensor([[17.0, -6.0, 11.0], [9.0, 15.0, -13.0], [-12.0, 7.0, 18.0]])

    def textured(view: int) -> Frame:
        frame = capture[view]
        waves = torch.sin(frame.camera.unproject_depth(frame.depth) @ directions)
        image = (127.5 + 100.0 * waves.mean(-1, keepdim=True)).expand(-1, -1, 3)
        return replace(frame, image=image.round().to(torch.uint8))

    return replace(capture, frames=textured, depth_kind="affine", metric=False)


def rows_with(most: float) -> torch.Tensor:
    rows = torch.zeros(VIEWS, ROW)
    rows[:, 0] = 1.0
    across = torch.linspace(-1.0, 1.0, CELLS)
    for view in range(VIEWS):
        tilt = across[None] if view % 2 else across[:, None]
        rows[view, GRID] = ((-1) ** (view // 2) * most * tilt).expand(CELLS, CELLS).reshape(-1)
    return rows


def error(room: Capture, rows: torch.Tensor) -> float:
    errors = []
    for view in range(VIEWS):
        depth = aligned_frame(room[view], rows[view], "affine").depth
        errors.append((depth / room[view].depth - 1.0).abs())
    together = torch.cat(errors)
    return together[torch.isfinite(together)].mean().item()


def test_bent_depth_straightens(room):
    bent = rows_with(0.03)
    found = bend(room, list(range(VIEWS)), bent, ignore)
    assert error(room, found) < 0.6 * error(room, bent)
    assert torch.equal(found[:, :4], bent[:, :4])


def test_right_depth_stays(room):
    true = rows_with(0.0)
    assert error(room, bend(room, list(range(VIEWS)), true, ignore)) < 0.004


def test_the_unit_of_the_scene_changes_nothing(room):
    """Law: a world ten times as large bends alike."""
    cameras = []
    for camera in room.cameras:
        pose = camera.world_from_cam.clone()
        pose[:3, 3] *= 10.0
        cameras.append(replace(camera, world_from_cam=pose))
    load = lambda view: replace(room[view], camera=cameras[view], depth=10.0 * room[view].depth)
    large = replace(room, cameras=tuple(cameras), frames=load, units_per_metre=10.0 * room.units_per_metre)
    bent = rows_with(0.02)
    a, b = (bend(capture, list(range(VIEWS)), bent, ignore) for capture in (room, large))
    torch.testing.assert_close(a[:, GRID], b[:, GRID], atol=2e-4, rtol=0)


def test_a_view_alone_or_not_aligned_stays_as_it_is(room):
    bent = rows_with(0.03)
    torch.testing.assert_close(bend(room, [2], bent, ignore), bent, atol=1e-6, rtol=0)
    assert torch.equal(bend(room, [], bent, ignore), bent)
    bent[3] = torch.nan
    heard = []
    found = bend(room, list(range(VIEWS)), bent, heard.append)
    assert torch.isnan(found[3]).all() and torch.isfinite(found[4]).all()
    assert heard[-1].done == heard[-1].total == 4 * (VIEWS - 1)
    field = spread(found[4, GRID].view(CELLS, CELLS), 72, 96)
    assert field.abs().max() < 0.15
