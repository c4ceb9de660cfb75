import json

import pytest
import torch

from goc.cli import doctor, main

NAMES = ["goc", "system", "processor", "vectors", "memory", "disk", "python", "torch", "numpy", "scipy", "pillow"]


def test_this_machine_can_run_goc(capsys):
    assert main(["doctor"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[1] for line in lines if not line.startswith(" ")] == [*NAMES, "kernels", "cuda", "gsplat"]
    assert any("a splat was drawn" in line for line in lines)


def test_findings_for_programs_are_json(capsys):
    assert main(["doctor", "--json"]) == 0
    findings = json.loads(capsys.readouterr().out)
    assert [found["name"] for found in findings][: len(NAMES)] == NAMES
    assert all(found["ok"] or found["remedy"] for found in findings)


def test_broken_kernels_are_found_by_trying_and_get_a_remedy(monkeypatch, capsys):
    monkeypatch.setattr(
        doctor, "rasterize", lambda splats, camera, channels: (channels.sum() + torch.zeros(16, 16, 1), None)
    )
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
