import io
from dataclasses import dataclass, field, replace

import msgspec
import numpy as np
import pytest
from PIL import Image

from assets import box_scene
from captures import write_nerfstudio
from goc.capture import load_capture
from goc.errors import FileError
from goc.events import Progress, Warned, ignore
from goc.export import WRITERS, export_scene
from goc.files import read_mesh, read_observed_mesh, read_scene, read_splats, write_json
from goc.report import read_report, write_overview, write_report
from goc.runs import RunRecord
from goc.scene import Completed


@dataclass(frozen=True)
class Nested:
    seed: int = 3


@dataclass(frozen=True)
class Settings:
    reconstruct: Nested = field(default_factory=Nested)
    units_per_metre: float | None = None


def closed(ids):
    """The room of two boxes, of which the first is closed."""
    scene = box_scene(ids)
    first = scene.objects[0]
    how = Completed(method="box", expected_error=0.0123456, trusted=False)
    return replace(scene, objects=(replace(first, solid=first.observed, completed=how), scene.objects[1]))


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    return load_capture(write_nerfstudio(tmp_path_factory.mktemp("capture"), views=5))


@pytest.fixture(scope="module")
def written(capture, tmp_path_factory):
    folder = tmp_path_factory.mktemp("out")
    record = RunRecord(ignore)
    with record.stage("export"):
        export_scene(folder, closed((7, 12)))
        write_overview(folder / "overview.png", closed((7, 12)), capture, "a room", 3, record)
    record(Warned(stage="capture", message="one view is dark"))
    write_report(folder / "report.json", folder / "capture", capture, closed((7, 12)), record, Settings())
    return folder


def test_ids_name_the_folders_and_every_file_reads_back(written):
    names = {str(path.relative_to(written)) for path in written.rglob("*") if path.is_file()}
    objects = {
        f"objects/{n}/{name}" for n in (12, 7) for name in ("observed.ply", "splats.ply", "evidence.safetensors")
    }
    objects |= {"objects/7/mesh.ply", "objects/7/mesh.glb"}
    scene = {"scene.json", "scene/mesh.ply", "scene/splats.ply", "scene/labels.safetensors"}
    assert names == objects | scene | {"overview.png", "report.json"}
    made = closed((7, 12))
    assert len(read_mesh(written / "scene/mesh.ply").faces) == 12
    assert (read_splats(written / "scene/splats.ply").means == made.splats.means).all()
    for item in made.objects:
        mesh, observed = read_observed_mesh(written / f"objects/{item.id}/observed.ply")
        assert np.array_equal(mesh.vertices, item.observed.mesh.vertices)
        assert np.array_equal(mesh.colours, item.observed.mesh.colours)
        assert np.array_equal(observed, item.observed.observed)
        assert len(read_splats(written / f"objects/{item.id}/splats.ply")) == 10
    assert [item.id for item in read_scene(written).objects] == [7, 12]


def test_every_format_stands_in_the_table():
    assert list(WRITERS) == ["ply", "glb"]


def test_the_report_holds_what_its_schema_says_and_closed_form_figures(written):
    report = read_report(written / "report.json")
    assert report.schema == 1
    assert (report.seed, report.config) == (3, {"reconstruct": {"seed": 3}, "units_per_metre": None})
    assert report.metrics == {"held_out_psnr_db": 21.5, "train_psnr_db": None}
    assert [(item.id, item.label, item.vertices, item.faces, item.splats) for item in report.objects] == [
        (7, "box 7", 8, 12, 10),
        (12, "box 12", 8, 12, 10),
    ]
    first = report.objects[0]  # 0.9 x 0.8 x 0.7 m
    assert first.area_m2 == pytest.approx(2 * (0.9 * 0.8 + 0.9 * 0.7 + 0.8 * 0.7), abs=1e-3)
    assert first.size_m == pytest.approx((0.9, 0.8, 0.7), abs=1e-3)
    assert first.observed_share == 0.5
    assert first.completion.watertight and 0 < first.completion.completed_share < 1
    how = first.completion
    assert (how.method, how.expected_error_m, how.trusted) == ("box", 0.01235, False)
    assert report.objects[1].completion is None
    assert (report.world.up, report.world.floor, report.world.confidence) == ((0.0, 0.0, 1.0), 0.0, 0.9)
    assert np.array_equal(report.world.level_from_world, np.eye(4))
    assert np.allclose(first.bounds, [[1.0, 0.8, 0.0], [1.9, 1.6, 0.7]])
    assert report.scene.area_m2 == pytest.approx(2 * (4 * 3 + 4 * 2.5 + 3 * 2.5), abs=1e-3)
    assert (report.capture.views, report.capture.width, report.capture.has_ids) == (5, 64, True)
    assert [(warning.stage, warning.message) for warning in report.warnings] == [("capture", "one view is dark")]
    assert report.seconds["export"] > 0
    assert 50 < report.peak_memory_mb < 100_000
    assert report.machine.cores >= 1


def test_lengths_in_the_report_are_metres_whatever_the_unit(capture, tmp_path):
    scene = box_scene(units_per_metre=10.0)
    write_report(tmp_path / "r.json", tmp_path, capture, scene, RunRecord(ignore), Settings())
    facts = read_report(tmp_path / "r.json").objects[0]
    assert facts.size_m == pytest.approx((0.09, 0.08, 0.07), abs=1e-4)
    assert facts.area_m2 == pytest.approx(2 * (0.9 * 0.8 + 0.9 * 0.7 + 0.8 * 0.7) / 100, abs=1e-4)
    assert facts.bounds[1] == pytest.approx((1.9, 1.6, 0.7))


def test_a_report_of_other_content_is_refused(written, tmp_path):
    other = msgspec.json.decode((written / "report.json").read_bytes()) | {"surprise": 1}
    (tmp_path / "report.json").write_bytes(msgspec.json.encode(other))
    with pytest.raises(FileError, match="surprise"):
        read_report(tmp_path / "report.json")
    write_json(tmp_path / "report.json", other | {"schema": 2})
    with pytest.raises(FileError, match=r"report\.json: has schema 2, and this goc reads 1"):
        read_report(tmp_path / "report.json")
    write_json(tmp_path / "report.json", {"goc": "0.1.0"})
    with pytest.raises(FileError, match=r"has schema 0 of an older goc.*Carve again"):
        read_report(tmp_path / "report.json")


def test_the_overview_is_a_picture_of_everything(written):
    picture = Image.open(io.BytesIO((written / "overview.png").read_bytes()))
    picture.load()
    assert picture.size[0] == 1720
    assert picture.size[1] > 1200
    assert len(picture.getcolors(maxcolors=1 << 24)) > 5000


def test_a_record_tells_each_warning_once_and_adds_up_stages():
    heard = []
    record = RunRecord(heard.append)
    warning, progress = Warned(stage="a", message="b"), Progress(stage="a", done=1, total=2)
    for event in (warning, progress, warning, progress):
        record(event)
    assert heard == [warning, progress, progress]
    assert record.warnings == [warning]
    for _ in range(2):
        with record.stage("x"):
            pass
    assert list(record.seconds) == ["x"]
