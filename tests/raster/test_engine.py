"""The choice of what draws: by a trial, with one line where it fails; and the calls that gsplat gets."""

import sys
from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch

import fake_gsplat
from goc.device import CPU
from goc.errors import EngineError
from goc.events import Warned
from goc.geometry.harmonics import colours_towards
from goc.raster import NATIVE, centre_depths, choose_engine, plane_channels, view_channels, views_of
from goc.raster.engine import CUDA, blend_natively, trial_cameras, trial_flaw, trial_splats
from goc.raster.gsplat_engine import blend_with_gsplat
from goc.raster.views import compiled_width, joined_views


@pytest.fixture
def gsplat(monkeypatch):
    monkeypatch.setitem(sys.modules, "gsplat", fake_gsplat.MODULE)


def broken(monkeypatch, answer):
    """gsplat that imports and then does something else than draw."""
    monkeypatch.setitem(sys.modules, "gsplat", SimpleNamespace(rasterization=answer))


def with_device(monkeypatch, flaw):
    """A machine that has a CUDA device, whose trial finds `flaw`."""
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr("goc.raster.engine.trial_flaw", lambda blend, device: flaw)


def test_gsplat_is_called_with_the_constants_of_the_cpu_engine_and_draws_the_same(gsplat):
    splats, channels = trial_splats(40, 8)
    views, per_view = views_of(trial_cameras(), CPU), torch.stack([channels, channels.flip(0)])
    image, alpha = blend_with_gsplat(splats, views, per_view)
    expected, expected_alpha = blend_natively(splats, views, per_view)
    assert image.shape == (2, 28, 40, 8)
    assert (image - expected).abs().mean() < 1e-5
    assert (alpha - expected_alpha).abs().mean() < 1e-5


def test_an_engine_that_draws_the_same_passes_the_trial(gsplat):
    assert trial_flaw(blend_with_gsplat, CPU) is None


def test_an_engine_that_draws_something_else_is_found_out(monkeypatch):
    def half_a_pixel_off(**call):
        call["Ks"] = call["Ks"] + 0.5 * torch.tensor([[0.0, 0, 1], [0, 0, 1], [0, 0, 0]])
        return fake_gsplat.rasterization(**call)

    broken(monkeypatch, half_a_pixel_off)
    assert "draws other images than the processor (off by" in trial_flaw(blend_with_gsplat, CPU)


def test_wrong_gradients_are_found_out(monkeypatch):
    def without_quats(**call):
        return fake_gsplat.rasterization(**{**call, "quats": call["quats"] * 2 - call["quats"].detach()})

    broken(monkeypatch, without_quats)
    assert "draws other gradients of quats" in trial_flaw(blend_with_gsplat, CPU)


def test_nothing_finite_is_found_out(monkeypatch):
    def nothing(**call):
        image, alpha, meta = fake_gsplat.rasterization(**call)
        return image * torch.nan, alpha, meta

    broken(monkeypatch, nothing)
    assert "draws other images" in trial_flaw(blend_with_gsplat, CPU)


def test_gsplat_without_kernels_fails_the_trial_in_one_line(monkeypatch, capsys):
    def disabled(**call):
        sys.stdout.write("gsplat: No CUDA toolkit found. gsplat will be disabled.\n")
        raise AttributeError("'NoneType' object has no attribute 'CameraModelType'\nsecond line")

    broken(monkeypatch, disabled)
    flaw = trial_flaw(blend_with_gsplat, CPU)
    assert "failed (AttributeError: 'NoneType' object has no attribute 'CameraModelType')" in flaw
    assert "\n" not in flaw and capsys.readouterr().out == ""


def test_a_missing_gsplat_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "gsplat", None)
    assert trial_flaw(blend_with_gsplat, CPU) == "gsplat is not installed"


def test_without_a_device_the_processor_draws_and_nobody_is_warned(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    heard = []
    assert choose_engine("auto", heard.append) is NATIVE
    assert heard == []
    with pytest.raises(
        EngineError, match=r"--device cuda cannot run here: PyTorch sees no CUDA device.*goc\[cuda\]"
    ) as caught:
        choose_engine("cuda")
    assert caught.value.exit_code == 4 and "\n" not in str(caught.value)


def test_a_device_that_fails_its_trial_is_told_of_once_and_not_used(monkeypatch):
    with_device(monkeypatch, "gsplat 1.5.3 draws other images")
    heard = []
    assert choose_engine("auto", heard.append) is NATIVE
    (warning,) = [event for event in heard if isinstance(event, Warned)]
    assert "the processor computes: gsplat 1.5.3 draws other images." in warning.message
    assert "pip install goc[cuda]" in warning.message
    with pytest.raises(EngineError, match="cannot run here: gsplat 1.5.3 draws other images"):
        choose_engine("cuda")


@pytest.mark.parametrize("wanted", ["auto", "cuda"])
def test_a_device_that_passes_its_trial_draws(monkeypatch, wanted):
    with_device(monkeypatch, None)
    engine = choose_engine(wanted)
    assert (engine.name, engine.device.type, engine.fused) == ("cuda", "cuda", False)
    assert engine is CUDA and engine.blend is blend_with_gsplat
    assert choose_engine("cpu") is NATIVE


@pytest.mark.parametrize("planes", [True, False])
@pytest.mark.parametrize(("degree", "features"), [(0, 0), (1, 0), (3, 5)])
def test_channels_of_several_views_are_those_of_each(planes, degree, features):
    splats, identity = trial_splats(30, max(features, 1))
    splats = replace(splats, sh=torch.randn(30, (degree + 1) ** 2, 3), identity=identity if features else None)
    cameras = trial_cameras()
    parts = [views_of([camera], CPU) for camera in cameras]
    found = view_channels(splats, joined_views(parts), planes)
    assert found.shape[2] == compiled_width((7 if planes else 4) + features)
    for camera, own in zip(cameras, found, strict=True):
        depth = plane_channels(splats, camera) if planes else centre_depths(splats, camera)[:, None]
        expected = [colours_towards(splats.sh, splats.means, camera.position), depth]
        expected += [identity] if features else []
        count = sum(part.shape[1] for part in expected)
        assert torch.allclose(own[:, :count], torch.cat(expected, 1), atol=1e-5)
        assert not own[:, count:].any()


def test_widths_are_those_that_gsplat_has_compiled():
    assert [compiled_width(count) for count in (1, 4, 7, 10, 16, 20, 33)] == [1, 4, 8, 16, 16, 32, 64]


@pytest.mark.gpu
def test_gsplat_and_the_cpu_engine_agree():
    """Values within 1e-3; gradients within 1e-2 of the largest, since sums are taken in another order."""
    pytest.importorskip("gsplat", reason="gsplat is not installed (pip install goc[cuda])")
    if not torch.cuda.is_available():
        pytest.skip("PyTorch sees no CUDA device")
    names = ("means", "quats", "log_scales", "opacity_logits")
    splats, channels = trial_splats(400, 8)
    results = []
    for device, blend in ((CPU, blend_natively), (torch.device("cuda"), blend_with_gsplat)):
        own = replace(splats, **{name: getattr(splats, name).detach().to(device).requires_grad_() for name in names})
        image, alpha = blend(own, views_of(trial_cameras(), device), channels.to(device).expand(2, -1, -1))
        (image.square().mean() + alpha.square().mean()).backward()
        results.append([image.detach().cpu(), alpha.detach().cpu(), *(getattr(own, name).grad.cpu() for name in names)])
    expected, found = results
    for exact, value in zip(expected[:2], found[:2], strict=True):
        # a pixel whose alpha lies within rounding of 1/255 may fall on either side
        assert (value - exact).abs().mean() < 1e-5 and ((value - exact).abs() > 1e-3).float().mean() < 1e-3
    for name, exact, value in zip(names, expected[2:], found[2:], strict=True):
        assert (value - exact).abs().max() < 1e-2 * exact.abs().max(), name
