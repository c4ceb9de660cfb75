"""A step of training reuses its buffers, and costs Python the same however many splats there are."""

import gc
import sys
from pathlib import Path

import pytest
import torch

from cameras import pinhole
from goc import _native
from goc.device import CPU
from goc.raster import NATIVE, BlendedViews, blend_views, rasterize, views_of
from goc.scene import Camera, Gaussians

VIEW = pinhole((38.0, 41.0))


def blend_view(gaussians: Gaussians, view: Camera, planes: bool) -> BlendedViews:
    return blend_views(gaussians, views_of([view], CPU), planes, NATIVE)


def random_splats(count: int) -> Gaussians:
    generator = torch.Generator().manual_seed(0)
    return Gaussians(
        means=(torch.randn(count, 3, generator=generator) * 0.4 + torch.tensor([0.0, 0.0, 2.4])).requires_grad_(),
        quats=torch.randn(count, 4, generator=generator).requires_grad_(),
        log_scales=(torch.randn(count, 3, generator=generator) * 0.6 - 2.4).requires_grad_(),
        opacity_logits=torch.randn(count, generator=generator).requires_grad_(),
        sh=torch.randn(count, 4, 3, generator=generator).requires_grad_(),
    )


def step(gaussians: Gaussians, view: Camera) -> None:
    shown = blend_view(gaussians, view, planes=True)
    (shown.colour.sum() + shown.geometry.sum() + shown.alpha.sum()).backward()


def test_steps_after_the_first_allocate_no_buffers():
    gaussians, view = random_splats(3000), VIEW
    _native.forget_idle_rasters()
    for _ in range(3):  # two buffers of the sort change places
        step(gaussians, view)
    before = _native.idle_rasters()
    assert len(before) == 1 and before[0] > 64 * 3000  # a cache line a splat, at least
    for _ in range(4):
        step(gaussians, view)
    assert _native.idle_rasters() == before


@pytest.mark.parametrize("draw", [blend_view, rasterize])
def test_a_view_that_is_forgotten_gives_its_buffers_back(draw):
    gaussians, view = random_splats(3000), VIEW
    _native.forget_idle_rasters()
    for _ in range(6):
        draw(gaussians, view, True if draw is blend_view else torch.ones(3000, 2))
    gc.collect()
    assert len(_native.idle_rasters()) == 1


def test_two_views_at_once_have_buffers_of_their_own():
    gaussians, view = random_splats(300), VIEW
    first = blend_view(gaussians, view, planes=True)
    alone = blend_view(random_splats(300), view, planes=True)
    alone.colour.sum().backward()
    blend_view(random_splats(20), view, planes=True).colour.sum().backward()
    first.colour.sum().backward()
    fresh = random_splats(300)
    blend_view(fresh, view, planes=True).colour.sum().backward()
    assert torch.equal(gaussians.means.grad, fresh.means.grad)


def calls_of_a_step(count: int) -> int:
    """Calls of Python and C functions that a step makes; backward included, which runs on this thread."""
    gaussians, view, calls = random_splats(count), VIEW, []
    step(gaussians, view)
    before, idle = sys.getprofile(), gc.isenabled()
    gc.disable()
    sys.setprofile(lambda frame, event, argument: calls.append(event))
    try:
        step(gaussians, view)
    finally:
        sys.setprofile(before)
        if idle:
            gc.enable()
    return len(calls)


def test_python_does_no_work_a_splat():
    assert calls_of_a_step(10) == calls_of_a_step(4000)


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="counts the threads that Linux shows")
def test_steps_start_no_threads():
    gaussians, view, before = random_splats(3000), VIEW, _native.thread_count()
    try:
        _native.set_thread_count(3)
        step(gaussians, view)
        threads = len(list(Path("/proc/self/task").iterdir()))
        for _ in range(4):
            step(gaussians, view)
        assert len(list(Path("/proc/self/task").iterdir())) == threads
    finally:
        _native.set_thread_count(before)
