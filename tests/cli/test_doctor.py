import json
import sys
from types import SimpleNamespace

import msgspec
import pytest
import torch

from goc.cli import doctor, main
from goc.runs import this_machine

NAMES = "goc system python torch numpy scipy pillow kernels processor vectors memory disk cuda gsplat".split()


def test_this_machine_can_run_goc(capsys):
    assert main(["doctor"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[1] for line in lines if not line.startswith(" ")] == NAMES
    assert any("a splat was drawn" in line for line in lines)


def test_findings_for_programs_are_json(capsys):
    assert main(["doctor", "--json"]) == 0
    findings = json.loads(capsys.readouterr().out)
    assert [found["name"] for found in findings] == NAMES
    assert all(found["ok"] or found["remedy"] for found in findings)


def test_broken_kernels_are_found_by_trying_and_get_a_remedy(monkeypatch, capsys):
    dark = torch.zeros(16, 16, 1)
    monkeypatch.setattr("goc.raster.rasterize", lambda splats, camera, channels: (channels.sum() + dark, None))
    monkeypatch.setattr(doctor, "_try_gsplat", lambda: "works")
    assert main(["doctor"]) == 4
    lines = capsys.readouterr().out.splitlines()
    (at,) = [n for n, line in enumerate(lines) if line.startswith("FAIL kernels")]
    assert "pip install --force-reinstall" in lines[at + 1]
    assert lines[-1] == "ok   gsplat      works"


@pytest.mark.parametrize("error", [RuntimeError("two\nlines"), RuntimeError()])
def test_whatever_a_trial_raises_is_one_line(error):
    def trial():
        raise error

    found = doctor._tried("x", trial, needed=False, remedy="mend it.")
    assert not found.ok
    assert found.value in ("two", "RuntimeError")


@pytest.mark.parametrize(
    ("flaw", "ok", "said"),
    [
        (None, True, "draws on the CUDA device as the processor does"),
        ("PyTorch sees no CUDA device", False, "installed, not used: PyTorch sees no CUDA device"),
    ],
)
def test_gsplat_is_judged_by_its_trial(monkeypatch, tmp_path, flaw, ok, said):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: name)
    monkeypatch.setattr(doctor, "version", lambda name: "1.5.3")
    monkeypatch.setattr("goc.raster.cuda_flaw", lambda: flaw)
    found = {finding.name: finding for finding in doctor.examine(tmp_path)}["gsplat"]
    assert (found.ok, found.needed) == (ok, False)
    assert "1.5.3 " + said in found.value
    assert ok or "pip install goc[cuda]" in found.remedy


def test_an_installation_without_kernels_is_examined_to_the_end(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "goc.raster", None)  # importing it fails, as it does without kernels
    assert main(["doctor"]) == 4
    shown = capsys.readouterr().out
    assert "FAIL kernels" in shown
    assert [line.split()[1] for line in shown.splitlines() if not line.startswith(" ")] == NAMES


def test_small_machines_are_told_what_to_ask_for(monkeypatch, tmp_path):
    small = msgspec.structs.replace(this_machine(), memory_gb=2.0, simd="portable")
    monkeypatch.setattr("goc.runs.this_machine", lambda: small)
    monkeypatch.setattr("shutil.disk_usage", lambda folder: SimpleNamespace(free=1e9))
    found = {finding.name: finding for finding in doctor.examine(tmp_path)}
    assert not any(found[name].ok for name in ("memory", "vectors", "disk"))
    assert found["memory"].value == "2.0 GB"
    assert "--capture.max-side-px" in found["memory"].remedy
    assert found["kernels"].ok
