import fcntl

import pytest

from goc.errors import ExportError
from goc.files.layout import REPORT
from goc.runs import check_output, claim_output, is_stopped_run


def fill(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(name)


def files(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def run(folder, *names, overwrite=False, resume=False):
    with claim_output(folder, overwrite, resume) as output:
        fill(output.staged, *names)
        output.publish()


def test_results_appear_only_when_published_and_nothing_else_is_left(tmp_path):
    out = tmp_path / "deep/out"
    with claim_output(out, overwrite=False, resume=False) as output:
        fill(output.staged, "scene/mesh.ply", REPORT)
        output.checkpoint.write_text("state")
        assert files(out) == [
            ".work/checkpoint.safetensors",
            ".work/lock",
            *sorted(f".work/staged/{n}" for n in (REPORT, "scene/mesh.ply")),
        ]
        output.publish()
        assert files(out) == [".work/lock", REPORT, "scene/mesh.ply"]
    assert files(out) == [REPORT, "scene/mesh.ply"]


def test_a_run_that_fails_before_any_checkpoint_leaves_no_trace(tmp_path):
    with pytest.raises(RuntimeError), claim_output(tmp_path / "out", overwrite=False, resume=False) as output:
        fill(output.staged, "scene/mesh.ply")
        raise RuntimeError
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("content", ["notes.txt", "scene/mesh.ply", ".hidden"])
def test_a_folder_with_content_is_refused_and_untouched(tmp_path, content):
    fill(tmp_path, content)
    with pytest.raises(ExportError, match=r"is not empty \(1 entries, first: .*pass --overwrite"):
        run(tmp_path, REPORT)
    assert files(tmp_path) == [content]


def test_overwriting_replaces_what_goc_wrote_and_nothing_else(tmp_path):
    run(tmp_path, REPORT, "scene/mesh.ply", "objects/7/observed.ply", "objects/8/observed.ply", "objects/9/splats.ply")
    fill(tmp_path, "scene.json", "scene/labels.safetensors", "objects/8/evidence.safetensors", "objects/9/mesh.glb")
    foreign = ["objects/9/mine.ply", "objects/readme.txt", "scene/notes.txt", "objects/seven/observed.ply"]
    fill(tmp_path, *foreign)
    (tmp_path / "objects/7/observed.ply").write_text("older")
    run(tmp_path, REPORT, "scene/mesh.ply", "objects/7/observed.ply", overwrite=True)
    assert files(tmp_path) == sorted([REPORT, "scene/mesh.ply", "objects/7/observed.ply", *foreign])
    assert (tmp_path / "objects/7/observed.ply").read_text() == "objects/7/observed.ply"
    assert not (tmp_path / "objects/8").exists()


def test_a_failing_run_leaves_earlier_results_as_they_were(tmp_path):
    run(tmp_path, REPORT, "scene/mesh.ply")
    with pytest.raises(RuntimeError), claim_output(tmp_path, overwrite=True, resume=False) as output:
        fill(output.staged, "scene/mesh.ply", "scene/splats.ply")
        raise RuntimeError
    assert files(tmp_path) == [REPORT, "scene/mesh.ply"]


def stopped(folder):
    with pytest.raises(KeyboardInterrupt), claim_output(folder, overwrite=False, resume=False) as output:
        output.checkpoint.write_text("state")
        raise KeyboardInterrupt


def test_a_stopped_run_keeps_its_checkpoint_and_must_be_resumed_or_dropped(tmp_path):
    stopped(tmp_path)
    assert is_stopped_run(tmp_path)
    with pytest.raises(ExportError, match=r"holds a stopped run.*--resume to continue it, or with --overwrite"):
        check_output(tmp_path, overwrite=False, resume=False)
    with claim_output(tmp_path, overwrite=False, resume=True) as output:
        assert output.resumes
        assert output.checkpoint.read_text() == "state"
    with claim_output(tmp_path, overwrite=True, resume=False) as output:
        assert not output.resumes
        assert not output.checkpoint.exists()
    assert not is_stopped_run(tmp_path)


def test_resuming_does_not_allow_to_overwrite(tmp_path):
    stopped(tmp_path)
    fill(tmp_path, "notes.txt")
    with pytest.raises(ExportError, match="is not empty"):
        check_output(tmp_path, overwrite=False, resume=True)
    check_output(tmp_path, overwrite=True, resume=True)


def test_resuming_nothing_starts_from_the_beginning(tmp_path):
    with claim_output(tmp_path / "new", overwrite=False, resume=True) as output:
        assert not output.resumes


def test_what_a_killed_run_left_without_checkpoint_is_no_obstacle(tmp_path):
    fill(tmp_path, ".work/lock", ".work/staged/scene/mesh.ply")
    run(tmp_path, REPORT)
    assert files(tmp_path) == [REPORT]


def test_two_runs_at_once_are_kept_apart(tmp_path):
    fill(tmp_path, ".work/lock")
    with (tmp_path / ".work/lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with pytest.raises(ExportError, match="another run of goc writes here"):
            run(tmp_path, REPORT)
    run(tmp_path, REPORT)


def test_a_path_that_cannot_be_a_folder_is_refused(tmp_path):
    fill(tmp_path, "file")
    with pytest.raises(ExportError, match=r"file: cannot be used as output folder \(Not a directory\)"):
        run(tmp_path / "file", REPORT)
    with pytest.raises(ExportError, match=r"file/below: cannot be used"):
        run(tmp_path / "file/below", REPORT)
    with pytest.raises(ExportError, match="cannot be used"):
        run(tmp_path / "nul\0", REPORT)
