import json

import numpy as np
import pytest
from PIL import Image

from captures import poses, write_nerfstudio
from damage import images, save
from damage import poses as changed_poses
from goc.capture.inspect import inspect_capture
from goc.cli import main
from goc.report.inspect_page import inspect_page
from goc.report.inspect_text import text_of


@pytest.fixture
def capture(tmp_path):
    return write_nerfstudio(tmp_path / "capture", views=24)


def test_a_sound_capture_has_no_damage(capture):
    told = inspect_capture(capture).inspection
    assert (told.format, told.views, told.looked_at, told.metric) == ("nerfstudio", 24, 24, True)
    assert [(size.width, size.height, size.views) for size in told.sizes] == [(64, 48, 24)]
    assert {one.name for one in told.objects} == {"crate", "cupboard"}
    assert told.depth.covered == 1.0
    assert told.up == pytest.approx((0, 0, 1), abs=0.1)
    assert told.findings == told.damage == told.ids_damage == told.few_views == []
    assert "nothing is wrong with it" in text_of(told)


def test_contradictions_are_findings_not_errors(capture):
    changed_poses(np.linalg.inv)(capture)
    told = inspect_capture(capture).inspection
    assert told.findings[0].severity == "contradiction"
    assert any("world-to-camera" in one.message for one in told.findings)


def test_a_dark_view_is_told(capture):
    path = capture / "images/0012.png"
    save(path, (np.array(Image.open(path)) * 0.6).astype(np.uint8))
    dark = [one for one in inspect_capture(capture).inspection.damage if one.what == "exposure"]
    assert dark[0].view == "images/0012.png"
    assert dark[0].value < -0.5


def test_ids_that_swap_are_told(capture):
    for number in (5, 6, 15, 16):
        path = capture / f"instance/{number:04d}.png"
        stored = np.array(Image.open(path))
        save(path, np.where(stored == 1, 2, np.where(stored == 2, 1, 0)).astype(np.uint8))
    told = inspect_capture(capture).inspection.ids_damage
    assert {(one.id, one.what, one.other) for one in told} >= {(1, "merges", 2), (2, "merges", 1)}
    assert {"images/0005.png", "images/0015.png"} <= {view for one in told for view in one.views}


def test_the_page_holds_everything_and_the_command_prints_json(capture, tmp_path, capsys):
    images("depth", lambda stored: stored)(capture)
    page = inspect_page(inspect_capture(capture))
    assert page.count("data:image/") == 2
    assert "cupboard" in page
    assert "<script" not in page
    assert main(["inspect", str(capture), "--json", "--out", str(tmp_path / "page.html")]) == 0
    assert json.loads(capsys.readouterr().out)["views"] == len(poses(24))
    assert (tmp_path / "page.html").read_text().startswith("<!doctype html>")
