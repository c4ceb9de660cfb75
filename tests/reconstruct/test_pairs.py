"""Comparing neighbouring views while optimising: who with whom, from when, and what is remembered."""

from dataclasses import fields, replace

import pytest
import torch

import captures
from goc.capture import CaptureConfig, load_capture
from goc.device import CPU
from goc.errors import ConfigError
from goc.raster import NATIVE, views_of
from goc.reconstruct import Losses, Mcmc, Multiview, ReconstructConfig, pair_loss, reconstruct
from goc.reconstruct.depth import draw_depth
from goc.reconstruct.losses import inverse_depth
from goc.reconstruct.losses.warp import warped
from goc.reconstruct.optimise import optimise
from goc.reconstruct.pairs import memory_stride, view_pairs
from goc.reconstruct.seed import seed
from goc.reconstruct.state import State, initial_state
from goc.reconstruct.task import Task
from goc.scene import Capture, Gaussians

WIDE = Multiview(max_angle_deg=60.0, max_baseline=3.0, start=0.4)
BOTH = Losses(photometric=0.3, geometric=0.3, multiview=WIDE)
QUICK = ReconstructConfig(iterations=30, checkpoint_every=20, mcmc=Mcmc(max_splats=1000, every=10), losses=BOTH)


def with_multiview(config: ReconstructConfig, **changed: object) -> ReconstructConfig:
    """The settings with other ones of comparing neighbours."""
    return replace(config, losses=replace(config.losses, multiview=replace(config.losses.multiview, **changed)))


RENDERED = with_multiview(QUICK, neighbour_depth="rendered")


class Stopped(Exception):
    """Stands for a killed process."""


@pytest.fixture(scope="module")
def capture(tmp_path_factory) -> Capture:
    return load_capture(captures.write_nerfstudio(tmp_path_factory.mktemp("room"), views=8), CaptureConfig())


def same(a: Gaussians, b: Gaussians) -> bool:
    pairs = [(getattr(a, item.name), getattr(b, item.name)) for item in fields(Gaussians)]
    return all((x is None and y is None) or torch.equal(x, y) for x, y in pairs)


def optimised(capture: Capture, config: ReconstructConfig) -> State:
    """The state after all steps, without priors of depth."""
    views = list(range(len(capture)))
    task = Task(
        capture=capture,
        views=views,
        names=[],
        extent=1.0,
        budget=1000,
        pairs=view_pairs(capture, views, config),
        prior=lambda *_: None,
        config=config,
        engine=NATIVE,
    )
    return optimise(task, lambda: initial_state(seed(capture, views, config), {}), lambda event: None, None, False)


@pytest.mark.parametrize("config", [QUICK, RENDERED], ids=["cached", "rendered"])
def test_a_stopped_run_resumes_bit_equal(capture, tmp_path, config):
    whole = reconstruct(capture, config)

    def stop(event):
        if event.stage == "reconstruct" and event.done == 23:
            raise Stopped

    checkpoint = tmp_path / "checkpoint.safetensors"
    with pytest.raises(Stopped):
        reconstruct(capture, config, stop, checkpoint)
    assert same(whole.gaussians, reconstruct(capture, config, checkpoint=checkpoint, resume=True).gaussians)


def test_every_loss_is_switched_off_by_its_weight(capture):
    found = {
        name: reconstruct(capture, replace(QUICK, checkpoint_every=0, losses=replace(BOTH, **weights))).gaussians
        for name, weights in {
            "none": {"photometric": 0.0, "geometric": 0.0},
            "photometric": {"photometric": 0.3, "geometric": 0.0},
            "geometric": {"photometric": 0.0, "geometric": 0.3},
        }.items()
    }
    assert not same(found["none"], found["photometric"])
    assert not same(found["none"], found["geometric"])
    assert not same(found["photometric"], found["geometric"])


def test_nothing_is_done_before_the_start(capture):
    late = with_multiview(QUICK, start=1.0)
    off = replace(late, losses=replace(late.losses, photometric=0.0, geometric=0.0))
    a, b = optimised(capture, late), optimised(capture, off)
    assert same(a.gaussians(), b.gaussians())
    assert b.views == {}


def test_depths_are_remembered_an_epoch_before_the_start(capture):
    state = optimised(capture, replace(with_multiview(QUICK, start=1.0), iterations=12))
    # steps 4 to 11 are one epoch and its neighbours: views that were drawn then, some of them twice
    assert 4 <= len(state.views) <= 8
    assert all(depth.dtype == torch.float16 and depth.shape == (48, 64) for depth in state.views.values())
    drawn = next(iter(state.views.values())).float()
    assert 0.2 < drawn[drawn > 0].median().item() < 2.0  # one over metres
    rendered = optimised(capture, replace(RENDERED, iterations=12))
    assert rendered.views == {}


def test_an_epoch_before_the_start_is_fewer_steps_of_more_views(capture):
    """Four views a step: all eight are drawn in steps 10 and 11, the last two before the start."""
    steps = []
    late = replace(with_multiview(QUICK, start=1.0), iterations=12, views_a_step=4, checkpoint_every=0)
    with pytest.MonkeyPatch.context() as patch:
        remember = pair_loss._remember
        patch.setattr(pair_loss, "_remember", lambda *given: steps.append(given[2].step) or remember(*given))
        state = optimised(capture, late)
    assert len(state.views) == 8 and steps == [10] * 4 + [11] * 4


def test_views_come_to_agree_and_photographs_find_the_surface(capture):
    """Seeds off by a few centimetres, and no depth to hold them; measured: 0.040, 0.035 and 51 mm, 42 mm."""

    def rough(index: int):
        noise = torch.randn(capture[index].depth.shape, generator=torch.Generator().manual_seed(index))
        return replace(capture[index], depth=capture[index].depth * (1 + 0.02 * noise))

    def after(photometric: float, geometric: float) -> State:
        losses = Losses(photometric=photometric, geometric=geometric, multiview=replace(WIDE, start=0.2))
        config = replace(QUICK, iterations=160, losses=losses)
        return optimised(replace(capture, frames=rough), config)

    plain = after(0.0, 0.0)
    assert disagreement(capture, after(0.0, 0.3)) < 0.95 * disagreement(capture, plain)
    assert depth_error(capture, after(1.0, 0.0)) < 0.9 * depth_error(capture, plain)


def depth_error(capture: Capture, state: State) -> float:
    """Median over all pixels, metres."""
    found = []
    for view, camera in enumerate(capture.cameras):
        depth = draw_depth(state.gaussians().detached(), views_of([camera], CPU), "plane", NATIVE)
        found.append((depth.numerator / depth.denominator - capture[view].depth).abs().flatten())
    return torch.cat(found).nanmedian().item()


def disagreement(capture: Capture, state: State) -> float:
    """Median relative difference between the depth of a pixel's point in a neighbour and what the neighbour shows."""
    pairs = view_pairs(capture, list(range(len(capture))), QUICK)
    assert pairs is not None
    posed = [views_of([camera], CPU) for camera in capture.cameras]
    depths = [draw_depth(state.gaussians().detached(), views, "plane", NATIVE) for views in posed]
    found = []
    for view, others in pairs.neighbours.items():
        for other in others:
            warp = warped(depths[view], posed[view], posed[other], inverse_depth(depths[other])[0], 1, 0.05)
            found.append((warp.z * warp.inverse - 1)[warp.smooth].abs())
    return torch.cat(found).median().item()


def test_held_out_views_are_nobodys_neighbour(capture):
    pairs = view_pairs(capture, [0, 1, 3, 4, 6, 7], QUICK)
    assert pairs is not None
    assert set(pairs.neighbours) == {0, 1, 3, 4, 6, 7}
    assert {other for others in pairs.neighbours.values() for other in others} <= {0, 1, 3, 4, 6, 7}
    assert any(pairs.neighbours.values())
    assert view_pairs(capture, [0, 1], replace(QUICK, losses=Losses(photometric=0.0, geometric=0.0))) is None


def test_thresholds_are_metres(capture):
    """The same room in a unit of centimetres has the same pairs."""

    def scaled(camera):
        pose = camera.world_from_cam.clone()
        pose[:3, 3] *= 100
        return replace(camera, world_from_cam=pose)

    large = replace(capture, cameras=tuple(map(scaled, capture.cameras)), units_per_metre=100.0)
    views = list(range(8))
    assert view_pairs(large, views, QUICK) == view_pairs(capture, views, QUICK)


def test_memory_of_depths_is_bounded(capture):
    cameras = [camera.resized(300, 200) for camera in capture.cameras]
    full = 2 * 300 * 200 * len(cameras)
    assert [memory_stride(cameras, budget) for budget in (full, full - 1, full // 9 + 1, full // 9)] == [1, 3, 3, 5]
    coarse = replace(QUICK, iterations=20)
    pairs = view_pairs(capture, list(range(8)), coarse)
    assert pairs is not None and pairs.stride == 1


def test_views_that_are_alone_are_told(capture):
    heard = []
    near = Losses(photometric=0.3, geometric=0.3, multiview=Multiview(max_baseline=0.051))
    lonely = replace(QUICK, iterations=3, checkpoint_every=0, losses=near)
    found = reconstruct(capture, lonely, heard.append)
    assert any("none of 8 views has a neighbour" in getattr(event, "message", "") for event in heard)
    off = replace(lonely, losses=replace(near, photometric=0.0, geometric=0.0))
    assert same(found.gaussians, reconstruct(capture, off).gaussians)


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        ({"neighbours": 0}, r"Multiview\.neighbours is 0: needs 1 or more"),
        ({"min_baseline": 2.0}, r"Multiview\.min_baseline is 2: needs less than Multiview\.max_baseline \(1\.5\)"),
        ({"min_baseline": -0.1}, r"Multiview\.min_baseline is -0\.1: needs 0 or more"),
    ],
)
def test_settings_that_make_no_pair_are_refused(wrong, text):
    with pytest.raises(ConfigError, match=text):
        Multiview(**wrong)
