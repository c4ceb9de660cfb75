import hashlib
import json

import numpy as np
import pytest

from goc.capture.load import load_capture
from goc.cli import main
from goc.errors import CaptureError, ConfigError, ExportError, FileError
from goc.files.images import read_ids, read_image
from goc.files.rasters import read_depth
from goc.synth.sensor import (
    ImageFaults,
    MonocularDepth,
    PoseFaults,
    SensorConfig,
    StructuredLight,
    degrade_capture,
)

EVERYTHING = SensorConfig(
    seed=4,
    depth=MonocularDepth(normals=True),
    image=ImageFaults(blur_px=2.0, exposure_ev=0.3),
    pose=PoseFaults(rotation_deg=1.0, translation_m=0.01),
    masks=0.3,
)


@pytest.fixture(scope="module")
def capture(demo_capture):
    return demo_capture[0]


@pytest.fixture(scope="module")
def degraded(capture, tmp_path_factory):
    return degrade_capture(capture, tmp_path_factory.mktemp("sensor") / "all", EVERYTHING)


def frames(folder):
    return json.loads((folder / "transforms.json").read_text())["frames"]


def digests(folder):
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def test_the_same_seed_gives_the_same_bytes_and_another_gives_others(capture, degraded, tmp_path):
    again = degrade_capture(capture, tmp_path / "again", EVERYTHING)
    assert digests(again) == digests(degraded)
    other = degrade_capture(capture, tmp_path / "other", SensorConfig(seed=5, depth=StructuredLight()))
    assert digests(other)["depth/0000.png"] != digests(degraded)["depth/0000.png"]


def test_what_no_fault_touches_stays(capture, tmp_path):
    before = digests(capture)
    out = degrade_capture(capture, tmp_path / "out", SensorConfig(depth=StructuredLight()))
    after = digests(out)
    changed = {name for name in before if after[name] != before[name]}
    assert changed == {name for name in before if name.startswith("depth/")}
    assert set(after) - set(before) == {"gt/sensor.json"} and digests(capture) == before


def test_depth_comes_back_with_the_kept_scale_and_offset(capture, degraded):
    document = json.loads((degraded / "transforms.json").read_text())
    truth = json.loads((degraded / "gt/sensor.json").read_text())
    assert document["depth_kind"] == "affine" and truth["model"] == "MonocularDepth"
    for frame in document["frames"][:3]:
        guess = read_depth(degraded / frame["depth_file_path"], 1.0 / document["depth_unit_scale_factor"])
        exact = read_depth(capture / frame["depth_file_path"])
        known = truth["frames"][frame["file_path"]]
        error = np.abs(known["scale"] * guess + known["offset"] - exact) / exact
        assert np.nanmedian(error) < 0.06 and guess.max() <= 1.0


def test_poses_images_normals_and_masks_are_those_of_the_settings(capture, degraded):
    truth = json.loads((degraded / "gt/sensor.json").read_text())["frames"]
    for before, after in zip(frames(capture), frames(degraded), strict=True):
        assert truth[before["file_path"]]["transform_matrix"] == before["transform_matrix"]
        assert after["transform_matrix"] != before["transform_matrix"]
        assert (read_image(degraded / after["file_path"]) != read_image(capture / before["file_path"])).any()
        normals = read_image(degraded / after["normal_file_path"]).astype(float) / 127.5 - 1
        lengths = np.linalg.norm(normals, axis=-1)
        assert (np.abs(lengths - 1) < 0.02).mean() > 0.99 and (normals[..., 2] < 0.3).mean() > 0.95
    ids = [
        read_ids(folder / frame["instance_file_path"]) for folder in (capture, degraded) for frame in frames(capture)
    ]
    half = len(ids) // 2
    assert any((a != b).any() for a, b in zip(ids[:half], ids[half:], strict=True))


def test_the_capture_reader_takes_the_copy(degraded, tmp_path, capture):
    out = degrade_capture(capture, tmp_path / "kinect", SensorConfig(depth=StructuredLight(), masks=0.2))
    frame = load_capture(out)[0]
    exact = load_capture(capture)[0]
    error = (frame.depth - exact.depth).abs()
    assert 0.001 < np.nanmedian(error.numpy()) < 0.03
    with np.load(out / "gt/points.npz") as archive:
        assert "seen" in archive.files


def test_sparse_lists_get_the_same_noise(capture, tmp_path):
    source = tmp_path / "source"
    degrade_capture(capture, source, SensorConfig(seed=1, masks=0.1))
    document = json.loads((source / "transforms.json").read_text())
    document["frames"] = document["frames"][1::3]
    (source / "transforms_sparse.json").write_text(json.dumps(document))
    out = degrade_capture(source, tmp_path / "out", SensorConfig(pose=PoseFaults(rotation_deg=1.0)))
    sparse = json.loads((out / "transforms_sparse.json").read_text())["frames"]
    assert sparse == frames(out)[1::3]
    only = degrade_capture(source / "transforms_sparse.json", tmp_path / "only", SensorConfig(masks=0.1))
    assert len(list((only / "images").iterdir())) == len(sparse)


def edited(capture, folder, **top):
    """A copy of the capture whose transforms.json differs."""
    source = degrade_capture(capture, folder, SensorConfig(masks=0.1))
    document = json.loads((source / "transforms.json").read_text())
    frame = {name: top.pop(name) for name in list(top) if name.endswith("_path")}
    document["frames"] = [entry | frame for entry in document["frames"]] if "frames" not in top else top.pop("frames")
    (source / "transforms.json").write_text(json.dumps(document | top))
    return source


@pytest.mark.parametrize(
    ("changes", "config", "error", "text"),
    [
        ({"frames": []}, SensorConfig(masks=0.1), CaptureError, "has no frames"),
        ({"depth_file_path": None}, SensorConfig(depth=StructuredLight()), CaptureError, "no frame has depth"),
        (
            {"depth_kind": "affine"},
            SensorConfig(depth=StructuredLight()),
            CaptureError,
            "its depth is affine, not metric",
        ),
        ({"file_path": "../secret.png"}, SensorConfig(masks=0.1), CaptureError, "lies outside the capture"),
        ({"fl_x": None}, SensorConfig(depth=StructuredLight()), CaptureError, "has no fl_x"),
        ({"depth_file_path": "depth/none.png"}, SensorConfig(depth=StructuredLight()), FileError, "not found"),
        ({"file_path": "nowhere/none.png"}, SensorConfig(masks=0.1), FileError, "not found"),
    ],
)
def test_captures_that_lack_something_are_refused(capture, tmp_path, changes, config, error, text):
    source = edited(capture, tmp_path / "source", **changes)
    with pytest.raises(error, match=text):
        degrade_capture(source, tmp_path / "out", config)
    assert not (tmp_path / "out" / "transforms.json").exists()


def test_masks_need_ids(capture, tmp_path):
    source = edited(capture, tmp_path / "source", instance_file_path=None)
    (source / "instance").rename(source / "elsewhere")
    with pytest.raises(CaptureError, match="no frame has ids"):
        degrade_capture(source, tmp_path / "out", SensorConfig(masks=0.1))


def test_misuse_is_refused(capture, tmp_path, capsys):
    with pytest.raises(CaptureError, match="no capture here"):
        degrade_capture(tmp_path, tmp_path / "out", SensorConfig(masks=0.1))
    with pytest.raises(ConfigError, match="No fault is switched on"):
        degrade_capture(capture, tmp_path / "out", SensorConfig(seed=3))
    (tmp_path / "mine.txt").write_text("precious")
    with pytest.raises(ExportError, match="not an empty folder"):
        degrade_capture(capture, tmp_path, SensorConfig(masks=0.1))
    assert main(["synth", "sensor", str(capture), str(tmp_path / "out"), "--kinect.noise-m", "0.1"]) == 2
    assert "--kinect.* means nothing with --model exact" in capsys.readouterr().err
    assert main(["synth", "telescope"]) == 2 and "no command 'telescope'" in capsys.readouterr().err
    assert main(["synth", "sensor", str(capture), str(tmp_path / "out"), "--model", "radar"]) == 2
    assert "--model is 'radar': needs exact, kinect, monocular or phone" in capsys.readouterr().err


def test_the_command_writes_the_copy(capture, tmp_path, capsys):
    assert main(["synth", "sensor", str(capture), str(tmp_path / "out"), "--model", "phone", "--seed", "2"]) == 0
    assert "goc carve" in capsys.readouterr().out
    depth = read_depth(tmp_path / "out/depth/0000.png")
    assert np.isfinite(depth).any()
