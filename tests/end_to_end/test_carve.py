"""From a folder of photographs to files, and every way of not getting there."""

import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
import torch

from captures import LABELS, LENS, OBJECTS, ROOM_BOX, poses, see, write_nerfstudio
from goc.capture import CaptureConfig
from goc.complete import CompleteConfig
from goc.errors import ExportError, FileError, ReconstructError
from goc.events import Progress, ignore
from goc.export import ExportConfig
from goc.extract import ExtractConfig
from goc.files import image_size, read_mesh, read_observed_mesh, read_scene, read_splats, write_points
from goc.pipeline import CarveConfig, carve
from goc.reconstruct import Mcmc, ReconstructConfig
from goc.report import read_report
from goc.scene import PointCloud
from oracles.watertight import signed_volume, trouble

TINY = CarveConfig(
    reconstruct=ReconstructConfig(iterations=60, checkpoint_every=20, mcmc=Mcmc(max_splats=4000)),
    extract=ExtractConfig(scene_voxel=0.05, object_voxel=0.03, object_cells=24, evidence_cells=24),
    export=ExportConfig(overview_views=1),
)
VIEWS = 24
FILES = ("evidence.safetensors", "mesh.glb", "mesh.ply", "observed.ply", "splats.ply")
SCENE_FILES = ["scene.json", "scene/labels.safetensors", "scene/mesh.ply", "scene/splats.ply"]


def stop_at(step):
    """A listener that gives up in the middle of the optimisation."""

    def notify(event):
        if isinstance(event, Progress) and event.stage == "reconstruct" and event.done == step:
            raise KeyboardInterrupt

    return notify


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    return write_nerfstudio(tmp_path_factory.mktemp("capture"), views=VIEWS)


@pytest.fixture(scope="module")
def finished(capture, tmp_path_factory):
    out = tmp_path_factory.mktemp("finished") / "out"
    carve(capture, out, TINY)
    return out


def test_a_capture_becomes_a_scene_and_its_objects(finished):
    objects = [f"objects/{number}/{name}" for number in OBJECTS for name in FILES]
    assert sorted(contents(finished)) == [*objects, "overview.png", "report.json", *SCENE_FILES]
    scene = read_mesh(finished / "scene/mesh.ply")
    low, high = np.percentile(scene.vertices, [1, 99], axis=0)
    assert np.abs(low - ROOM_BOX[0]).max() < 0.1
    assert np.abs(high - ROOM_BOX[1])[:2].max() < 0.1  # nobody looked up
    assert len(read_splats(finished / "scene/splats.ply")) <= 4000
    for number, box in OBJECTS.items():
        mesh, observed = read_observed_mesh(finished / f"objects/{number}/observed.ply")
        outside = np.maximum(box[0] - mesh.vertices, mesh.vertices - box[1]).max(-1)
        assert np.abs(outside).mean() < 0.03  # on the faces of the true box, metres
        assert observed.mean() > 0.5
        a, b, c = (mesh.vertices[mesh.faces] - box.mean(0)).transpose(1, 0, 2)
        assert (np.cross(a, b) * c).sum() > 0  # counter-clockwise from outside
        closed, seen = read_observed_mesh(finished / f"objects/{number}/mesh.ply")
        assert trouble(closed.vertices, closed.faces) == ""
        assert 0.2 < seen.mean() < 1.0
        assert signed_volume(closed.vertices, closed.faces) == pytest.approx(np.prod(box[1] - box[0]), rel=0.35)
        own = read_splats(finished / f"objects/{number}/splats.ply")
        assert len(own) > 20
    assert image_size(finished / "overview.png")[0] == 1720


def test_a_finished_run_reads_back_as_the_scene_that_it_made(capture, finished, tmp_path):
    made = carve(capture, tmp_path / "out", TINY)
    read = read_scene(finished)
    assert torch.equal(read.splats.means, made.splats.means) and torch.equal(read.labels, made.labels)
    assert list(read.cameras) == list(made.cameras) and len(read.cameras) == VIEWS
    for one, other in zip(read.objects, made.objects, strict=True):
        assert (one.id, one.name) == (other.id, other.name)
        assert np.array_equal(one.solid.mesh.vertices, other.solid.mesh.vertices)
        assert np.array_equal(one.evidence.state, other.evidence.state)
    assert read.world.up.tolist() == [0.0, 0.0, 1.0] and read.world.confidence > 0.8
    assert read.world.floor == pytest.approx(0.0, abs=0.02)
    assert read.settings == made.settings and read.settings["extract"]["scene_voxel"] == 0.05


def test_the_report_tells_the_whole_run(finished, capture):
    report = read_report(finished / "report.json")
    assert list(report.seconds) == ["capture", "align", "ids", "reconstruct", "extract", "complete", "export"]
    assert (report.capture.path, report.capture.views) == (str(capture), VIEWS)
    assert [(item.id, item.label) for item in report.objects] == [(1, LABELS["1"]), (2, LABELS["2"])]
    for item in report.objects:
        assert item.completion is not None and item.completion.watertight
        assert 0.0 < item.completion.completed_share < 1.0
    assert report.metrics["held_out_psnr_db"] > 15
    assert report.config["reconstruct"]["iterations"] == 60
    assert report.config["extract"]["scene_voxel"] == 0.05
    assert report.warnings == []


def test_a_stopped_run_resumes_to_the_very_same_bytes(capture, finished, tmp_path):
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        carve(capture, out, TINY, stop_at(33))
    assert sorted(contents(out)) == [".work/checkpoint.safetensors", ".work/lock"]
    with pytest.raises(ExportError, match="holds a stopped run"):
        carve(capture, out, TINY)
    with pytest.raises(ReconstructError, match=r"with other settings\. Repeat the command that made it"):
        carve(capture, out, replace(TINY, reconstruct=replace(TINY.reconstruct, seed=1)), resume=True)
    steps = []
    carve(capture, out, TINY, lambda event: steps.append(event), resume=True)
    done = [event.done for event in steps if isinstance(event, Progress) and event.stage == "reconstruct"]
    assert done == list(range(21, 61))
    ours, theirs = contents(out), contents(finished)
    assert ours.keys() == theirs.keys()
    for name in ours.keys() - {"report.json", "overview.png"}:
        assert ours[name] == theirs[name], name


def test_a_folder_with_results_is_refused_unless_told_and_survives_a_failure(capture, finished):
    before = contents(finished)
    with pytest.raises(ExportError, match=r"is not empty \(5 entries, first: objects\)"):
        carve(capture, finished, TINY)
    with pytest.raises(KeyboardInterrupt):
        carve(capture, finished, replace(TINY, export=ExportConfig(overwrite=True)), stop_at(10))
    assert contents(finished) == before


def test_objects_are_told_apart_without_ids(capture, tmp_path):
    scene = carve(capture, tmp_path / "out", replace(TINY, capture=CaptureConfig(use_ids=False)))
    assert len(scene.objects) >= 2
    report = read_report(tmp_path / "out/report.json")
    assert "segment" in report.seconds
    assert not report.capture.has_ids


def test_photographs_with_points_go_all_the_way(tmp_path):
    """Neither depth nor ids, as from structure from motion: depth is rendered, and objects are told apart in it."""
    source = write_nerfstudio(tmp_path / "photos", views=VIEWS)
    write_points(source / "points.ply", surface_points())
    config = replace(TINY, capture=CaptureConfig(use_ids=False, use_depth=False, units_per_metre=1.0))
    heard = []
    scene = carve(source, tmp_path / "out", config, heard.append)
    stages = {event.stage for event in heard if isinstance(event, Progress)}
    assert stages >= {"reconstruct", "segment", "label", "export"}
    report = read_report(tmp_path / "out/report.json")
    assert len(report.objects) == len(scene.objects) >= 1
    assert sum(item.splats for item in report.objects) > 100
    assert not report.capture.has_depth


def surface_points():
    """What six views see, thinned: 2,000 coloured points."""
    positions, colours = [], []
    for pose in poses(6):
        shot = see(pose)
        v, u = np.mgrid[0 : LENS.height : 3, 0 : LENS.width : 3]
        x, y = ((p + 0.5 - c) / f for p, c, f in zip((u, v), LENS.centre_px, LENS.focal_px, strict=True))
        rays = np.stack([x, y, np.ones_like(x)], -1) * shot.depth[v, u, None]
        positions.append((rays @ pose[:3, :3].T + pose[:3, 3]).reshape(-1, 3))
        colours.append(shot.image[v, u].reshape(-1, 3))
    return PointCloud(positions=np.concatenate(positions).astype(np.float32), colours=np.concatenate(colours))


# A shell that starts the suite in the background makes its children deaf to Ctrl-C; this one shall hear it.
HEARS_CTRL_C = (
    "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
    "from goc.cli import main; sys.exit(main())"
)


@pytest.mark.parametrize(("how", "code"), [(signal.SIGINT, 130), (signal.SIGKILL, -9)])
def test_a_process_that_is_stopped_leaves_its_checkpoint(capture, tmp_path, how, code):
    out = tmp_path / "out"
    words = ["carve", str(capture), "--out", str(out), "--iterations", "1000000"]
    words += ["--reconstruct.checkpoint-every", "2", "--reconstruct.mcmc.max-splats", "500"]
    command = [sys.executable, "-c", HEARS_CTRL_C, *words]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            patience = time.monotonic() + 100
            while not (out / ".work/checkpoint.safetensors").is_file() and time.monotonic() < patience:
                time.sleep(0.05)
            process.send_signal(how)
            said = process.communicate(timeout=100)[1]
        finally:
            process.kill()
    assert process.returncode == code, said
    assert (out / ".work/checkpoint.safetensors").is_file()
    assert "Traceback" not in said
    if how != signal.SIGKILL:
        assert said.splitlines()[-1].endswith("--resume")
        assert "the last checkpoint is on disk. Continue with: goc carve" in said
    assert carve_again(capture, out) == "holds a stopped run"


def carve_again(capture, out):
    with pytest.raises(ExportError) as refused:
        carve(capture, out, TINY, ignore)
    return "holds a stopped run" if "holds a stopped run" in str(refused.value) else str(refused.value)


def test_weights_that_are_not_there_are_told_before_the_work(tmp_path):
    room = write_nerfstudio(tmp_path / "room", views=8)
    config = replace(TINY, complete=CompleteConfig(method="lite", weights=tmp_path / "none.safetensors"))
    heard = []
    with pytest.raises(FileError, match=r"none\.safetensors"):
        carve(room, tmp_path / "out", config, heard.append)
    assert heard == [] and not (tmp_path / "out").exists()
