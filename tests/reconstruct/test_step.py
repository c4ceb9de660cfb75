"""A training step: in native kernels, and in plain PyTorch as on a device, it is the same optimisation.

For the latter the processor stands for the device: its engine is not fused, nothing is dispatched to native kernels,
and `blend_natively` stands for gsplat, so that everything but gsplat's own kernels is run here.
"""

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

import captures
from goc.capture import CaptureConfig, load_capture
from goc.device import CPU
from goc.errors import ConfigError, ReconstructError
from goc.events import ignore
from goc.extract import rendered_views
from goc.files import write_png
from goc.geometry.monocular import EPOCH
from goc.priors.monocular import align_views
from goc.raster import NATIVE
from goc.reconstruct import Losses, Mcmc, Monocular, Multiview, ReconstructConfig, geometry_prior
from goc.reconstruct import reconstruct as reconstruct_with
from goc.reconstruct.adam import adam
from goc.reconstruct.losses.penalties import add_penalties
from goc.reconstruct.schedule import epoch_of_step, steps_of_epoch, views_of_step
from goc.reconstruct.state import initial_state
from goc.reconstruct.step import TrainingStep
from goc.reconstruct.task import Task
from goc.reconstruct.training_views import UploadedViews
from goc.scene import UNLABELLED, Capture, CapturePriors, CoarseDepth, Gaussians, Reconstruction

PINK = (255, 0, 160)
ON_DEVICE = replace(NATIVE, fused=False)
STILL = Mcmc(max_splats=600, every=5, noise=0.0)
"""Without noise, which native steps draw for fewer splats."""
BASE = ReconstructConfig(
    iterations=16,
    checkpoint_every=0,
    mcmc=STILL,
    losses=Losses(photometric=0.3, geometric=0.1, multiview=Multiview(max_angle_deg=60.0, max_baseline=3.0, start=0.5)),
)


def with_multiview(config: ReconstructConfig, **changed: object) -> ReconstructConfig:
    """The settings with other ones of comparing neighbours."""
    return replace(config, losses=replace(config.losses, multiview=replace(config.losses.multiview, **changed)))


VARIANTS = {
    "planes": BASE,
    "expected": replace(BASE, depth="expected", sh_degree=3),
    "rendered": with_multiview(BASE, neighbour_depth="rendered"),
    "depth alone": replace(BASE, losses=Losses(depth_normal=0.0, photometric=0.0)),
}


@contextmanager
def in_plain_torch() -> Iterator[None]:
    """Dispatch nothing to native kernels."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("goc.reconstruct.kernels.natively", lambda tensor: False)
        yield


def reconstruct(capture: Capture, *arguments, engine, **named) -> Reconstruction:
    with nullcontext() if engine.fused else in_plain_torch():
        return reconstruct_with(capture, *arguments, engine=engine, **named)


@pytest.fixture(scope="module")
def capture(tmp_path_factory) -> Capture:
    return load_capture(captures.write_nerfstudio(tmp_path_factory.mktemp("room"), views=8), CaptureConfig())


def random_state(seed: int = 0):
    generator = torch.Generator().manual_seed(seed)
    shapes = {"means": (50, 3), "quats": (50, 4), "log_scales": (50, 3), "opacity_logits": (50,), "sh": (50, 4, 3)}
    state = initial_state(Gaussians(**{k: torch.randn(*s, generator=generator) for k, s in shapes.items()}), {})
    for name, parameter in state.parameters.items():
        parameter.grad = torch.randn(parameter.shape, generator=generator)
        state.first[name] = torch.randn(parameter.shape, generator=generator)
        state.second[name] = torch.rand(parameter.shape, generator=generator)
    state.step = 6
    return state


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_same_splats_come_out_as_of_native_steps(capture, variant):
    config = VARIANTS[variant]
    native, device = (reconstruct(capture, config, engine=engine) for engine in (NATIVE, ON_DEVICE))
    assert len(native.gaussians) == len(device.gaussians)
    first = reconstruct(capture, replace(config, iterations=1), engine=NATIVE).gaussians
    moved = (native.gaussians.means - first.means).norm(dim=-1).median()
    # Adam divides by the size of gradients: those near zero turn rounding into steps of other splats
    apart = (native.gaussians.means - device.gaussians.means).norm(dim=-1)
    assert apart.median() < 0.01 * moved
    assert device.metrics["train_psnr_db"] == pytest.approx(native.metrics["train_psnr_db"], abs=0.1)
    assert (native.labels == device.labels).float().mean() > 0.99


def test_adam_is_the_native_one():
    rates = {name: (0.1 * place,) for place, name in enumerate(random_state().parameters, 1)}
    rates["sh"] = (0.1, 0.1, 0.1, 0.7)
    native, device = random_state(), random_state()
    adam(native, rates)
    with in_plain_torch():
        adam(device, rates)
    for name, parameter in native.parameters.items():
        assert torch.allclose(parameter, device.parameters[name], rtol=1e-5, atol=1e-6), name
        assert torch.allclose(native.first[name], device.first[name], rtol=1e-5, atol=1e-6), name
        assert torch.allclose(native.second[name], device.second[name], rtol=1e-5, atol=1e-6), name
        assert device.parameters[name].grad is None


def test_penalties_are_the_native_ones():
    native, device = random_state(), random_state()
    for state in (native, device):
        state.parameters["opacity_logits"].grad[::3] = 0.0  # not in view
    before = device.parameters["log_scales"].grad.clone()
    add_penalties(native.parameters["opacity_logits"], native.parameters["log_scales"], BASE.mcmc)
    with in_plain_torch():
        add_penalties(device.parameters["opacity_logits"], device.parameters["log_scales"], BASE.mcmc)
    for name in ("opacity_logits", "log_scales"):
        assert torch.allclose(native.parameters[name].grad, device.parameters[name].grad, atol=1e-6), name
    assert torch.equal(before[::3], device.parameters["log_scales"].grad[::3])


def test_features_fill_what_colour_and_depth_leave_of_sixteen_channels(capture):
    config = replace(BASE, iterations=30, labels="learned", depth="expected")
    found = reconstruct(capture, config, engine=ON_DEVICE)
    assert found.gaussians.identity.shape[1] == 12
    voted = reconstruct(capture, replace(config, labels="votes"), engine=ON_DEVICE)
    assert (found.labels == voted.labels).float().mean() > 0.6


def test_several_views_a_step_are_their_mean(capture):
    config = replace(BASE, views_a_step=3, iterations=6)
    native, device = (reconstruct(capture, config, engine=engine) for engine in (NATIVE, ON_DEVICE))
    apart = (native.gaussians.means - device.gaussians.means).norm(dim=-1)
    alone = reconstruct(capture, replace(config, views_a_step=1), engine=ON_DEVICE)
    assert apart.median() < 0.05 * (native.gaussians.means - alone.gaussians.means).norm(dim=-1).median()
    with pytest.raises(ConfigError, match="ReconstructConfig.views_a_step is 0: needs 1 or more"):
        replace(config, views_a_step=0)


def test_views_of_several_sizes_go_in_calls_of_one_size(capture):
    small = capture.cameras[0].resized(32, 24)

    def load(index):
        frame = capture[index]
        if index:
            return frame
        pick = {name: getattr(frame, name)[::2, ::2].contiguous() for name in ("image", "depth", "ids")}
        return replace(frame, camera=small, normals=None, **pick)

    mixed = replace(capture, cameras=(small, *capture.cameras[1:]), frames=load)
    sizes = set()

    def blend(gaussians, views, channels):
        sizes.add((len(views.cameras), views.height, views.width))
        return NATIVE.blend(gaussians, views, channels)

    reconstruct(mixed, replace(BASE, views_a_step=8, iterations=1), engine=replace(ON_DEVICE, blend=blend))
    assert sizes == {(1, 24, 32), (7, 48, 64)}


def haze(gaussians, views, channels):
    """Every pixel shows every splat: PyTorch alone, in place of an engine that computes on the processor."""
    shares = (gaussians.opacity_logits.sigmoid() * gaussians.log_scales.exp().sum(-1)).softmax(0)
    size = (len(views.cameras), views.height, views.width)
    image = torch.einsum("n,vnc->vc", shares, channels)[:, None, None].expand(*size, -1)
    return image, (1.0 - shares.square().sum()).expand(size)


class Asynchronous(TorchDispatchMode):
    """Refuses operations for which the processor waits: their result's size or value is known to the device alone."""

    WAITING = ("_local_scalar_dense", "nonzero", "masked_select", "_unique2", "equal", "is_nonzero", "item")

    def __torch_dispatch__(self, operation, types, arguments=(), named=None):
        name = operation.name().removeprefix("aten::").partition(".")[0]
        indices = arguments[1] if name in ("index", "index_put", "index_put_") else ()
        by_mask = any(index is not None and index.dtype == torch.bool for index in indices)
        to_processor = name == "_to_copy" and (named or {}).get("device") == CPU
        assert not by_mask and name not in self.WAITING and not to_processor, name
        return operation(*arguments, **(named or {}))


def test_steps_between_looks_never_wait_for_the_device(capture, monkeypatch):
    step, calls = TrainingStep.__call__, []

    def refused(*arguments, **named):
        raise AssertionError("a step waits for the device")

    def guarded(self, state):
        if not 16 <= state.step < 39:  # views are on their way, or it is a look
            return step(self, state)
        calls.append(state.step)
        with monkeypatch.context() as patch, Asynchronous():
            for name in ("tolist", "cpu", "numpy"):
                patch.setattr(torch.Tensor, name, refused)
            # the true ones draw on the processor
            patch.setattr("goc.reconstruct.step.views_of_step", lambda task, number: [task.views[number % 8]])
            patch.setattr("goc.reconstruct.pair_loss.neighbour_of_step", lambda *given: (given[3] + 1) % 8)
            return step(self, state)

    monkeypatch.setattr(TrainingStep, "__call__", guarded)
    early = with_multiview(BASE, start=0.3)  # every view is remembered when the first of these steps comes
    config = replace(early, iterations=40, mcmc=replace(STILL, every=1000))
    reconstruct(capture, config, engine=replace(ON_DEVICE, blend=haze))
    assert len(calls) == 23


def test_views_that_do_not_fit_are_brought_again(capture, monkeypatch):
    kept = reconstruct(capture, replace(BASE, iterations=12), engine=ON_DEVICE).gaussians
    loads, start = [], UploadedViews.__init__

    def small(self, task, device):
        start(self, task, device)
        self._room = 2 * (3 + 4 + 3) * 64 * 48 + 1000  # colour, depth, normals; and poses
        load = task.capture.frames
        counting = replace(task.capture, frames=lambda index: loads.append(index) or load(index))
        self._task = replace(task, capture=counting)

    monkeypatch.setattr(UploadedViews, "__init__", small)
    streamed = reconstruct(capture, replace(BASE, iterations=12), engine=ON_DEVICE).gaussians
    assert torch.equal(kept.means, streamed.means)
    counts = sorted(loads.count(view) for view in range(8))
    assert counts[0] == counts[1] == 1 and counts[-1] > 1


def test_a_checkpoint_of_one_engine_goes_on_with_another(capture, tmp_path):
    checkpoint, config = tmp_path / "checkpoint.safetensors", replace(BASE, checkpoint_every=5)

    def stop(event):
        if event.stage == "reconstruct" and event.done == 8:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        reconstruct(capture, config, stop, checkpoint, engine=ON_DEVICE)
    resumed = reconstruct(capture, config, checkpoint=checkpoint, resume=True, engine=NATIVE)
    whole = reconstruct(capture, config, engine=ON_DEVICE)
    assert resumed.metrics["train_psnr_db"] == pytest.approx(whole.metrics["train_psnr_db"], abs=0.1)


def halved(capture: Capture, aligned: int) -> Capture:
    """The capture with half its depth, called affine; of the first views it is known."""
    known = {view: CoarseDepth(camera=capture.cameras[view], depth=capture[view].depth) for view in range(aligned)}

    def load(index):
        frame = capture[index]
        return replace(frame, depth=0.5 * frame.depth, normals=None)

    affine = replace(capture, frames=load, depth_kind="affine", points=None)
    rows = align_views(affine, list(range(len(capture))), known, ignore)
    return replace(affine, priors=CapturePriors(alignment=rows))


def test_monocular_depth_is_fitted_to_what_the_splats_show(capture):
    """Views that nothing is known of wait for the splats; then all are compared."""
    found = [reconstruct(halved(capture, aligned=4), BASE, engine=engine) for engine in (NATIVE, ON_DEVICE)]
    apart = (found[0].gaussians.means - found[1].gaussians.means).norm(dim=-1)
    assert apart.median() < 1e-3


def test_epochs_are_counted_in_views_not_in_steps(capture, monkeypatch):
    """Eight views, four a step: an epoch is two steps, in which every view's alignment is fitted again."""
    losses = replace(BASE.losses, monocular=Monocular(refresh_every=1))
    config = replace(BASE, views_a_step=4, iterations=12, losses=losses)
    refresh, runs = geometry_prior.refresh, {}

    def watched(row, frame, kind, shown, epoch, monocular):
        before = row[EPOCH].item()
        refresh(row, frame, kind, shown, epoch, monocular)
        log.append((epoch, before, row[EPOCH].item()))

    monkeypatch.setattr(geometry_prior, "refresh", watched)
    for engine in (NATIVE, ON_DEVICE):
        log = []
        runs[engine] = reconstruct(halved(capture, aligned=8), config, engine=engine), log
    (native, epochs), (device, same_epochs) = runs.values()
    assert epochs == same_epochs
    assert [epoch for epoch, _, _ in epochs] == [step // 2 for step in range(12) for _ in range(4)]
    assert all(after == epoch for epoch, _, after in epochs)
    assert all(before == max(epoch - 1, 0) for epoch, before, _ in epochs)
    assert (native.gaussians.means - device.gaussians.means).norm(dim=-1).median() < 1e-3


def task_of(capture: Capture, views: list[int], config: ReconstructConfig) -> Task:
    return Task(
        capture=capture,
        views=views,
        names=[],
        extent=1.0,
        budget=600,
        pairs=None,
        prior=lambda *_: None,
        config=config,
        engine=NATIVE,
    )


@pytest.mark.parametrize(("views", "a_step", "steps"), [(8, 1, 8), (8, 4, 2), (8, 3, 3), (8, 16, 1)])
def test_an_epoch_takes_as_many_steps_as_its_views_need(capture, views, a_step, steps):
    task = task_of(capture, list(range(views)), replace(BASE, views_a_step=a_step))
    assert steps_of_epoch(task) == steps
    drawn = [view for step in range(views) for view in views_of_step(task, step)]
    for epoch in range(a_step):
        assert sorted(drawn[epoch * views : (epoch + 1) * views]) == task.views
    for step in range(views):
        assert epoch_of_step(task, step) == step * a_step // views


def test_a_loss_that_is_not_finite_is_named_at_the_next_look(capture):
    loads = iter(range(1000))

    def spoilt(index):
        frame = capture[index]
        if next(loads) < len(capture):  # good for the seeds
            return frame
        return replace(frame, depth=torch.full_like(frame.depth, 3.4e38))

    with pytest.raises(ReconstructError, match=r"images/.*: the loss is not finite at step 0"):
        reconstruct(replace(capture, frames=spoilt), BASE, engine=ON_DEVICE)


def pink_capture(folder, masked):
    """The left third of every photograph is pink, which nothing in the room is."""

    def change(document):
        for number, frame in enumerate(document["frames"]):
            pixels = captures.see(captures.poses(4)[number]).image.copy()
            pixels[:, :20] = PINK
            write_png(folder / frame["file_path"], pixels)
            if masked:
                frame["mask_path"] = "mask.png"

    mask = np.full((48, 64), 255, np.uint8)
    mask[:, :20] = 0
    write_png(folder / "mask.png", mask)
    return load_capture(captures.write_nerfstudio(folder, views=4, change=change))


@pytest.mark.parametrize("engine", [NATIVE, ON_DEVICE], ids=["native", "torch"])
def test_what_a_mask_leaves_out_is_neither_seeded_nor_learned(tmp_path, engine):
    config = replace(BASE, iterations=12, losses=Losses(photometric=0.0, geometric=0.0))
    shares = []
    for masked in (True, False):
        folder = tmp_path / str(masked)
        folder.mkdir()
        capture = pink_capture(folder, masked)
        made = reconstruct(capture, config, engine=engine)
        colours = made.gaussians.sh[:, 0] * 0.28209479 + 0.5
        shares.append(((colours - torch.tensor(PINK) / 255).abs().amax(-1) < 0.15).float().mean().item())
        if masked:
            views = rendered_views(made, capture)
            assert views[1].depth[:, :20].isnan().all() and (views[1].ids[:, :20] == UNLABELLED).all()
            assert views[1].depth[:, 24:].isfinite().float().mean() > 0.5
    assert shares[0] < 0.01 < 0.1 < shares[1]
