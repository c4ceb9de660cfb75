"""The two engines that draw splats, and the trial that checks whether the one for CUDA works."""

import contextlib
import io
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from goc.device import CPU, FIRST, DeviceName, choose_device
from goc.events import Listener, Progress, ignore
from goc.raster.gsplat_engine import blend_with_gsplat
from goc.raster.rasterize import rasterize, stacked
from goc.raster.views import Views, views_of
from goc.scene.camera import Camera
from goc.scene.gaussians import Gaussians

Blend = Callable[[Gaussians, Views, Float[Tensor, "v n c"]], tuple[Float[Tensor, "v h w c"], Float[Tensor, "v h w"]]]
"""Draws the channels of n splats into v views: images and opacities. `rasterize` does the same for one view."""

_TOLERANCE = 1e-2
"""Largest error of the trial as a share of the largest value; wrong conventions exceed it by far, rounding does not."""
_SPLATS, _CHANNELS = 24, 8


@dataclass(frozen=True, kw_only=True, eq=False)
class Engine:
    """A function that draws splats, and the device of its tensors."""

    name: Literal["cpu", "cuda"]
    device: torch.device
    blend: Blend
    fused: bool
    """True: a training step draws each view in one native call, which makes the channels too. False: it draws all views
    of one size in one call, from channels made in PyTorch."""


def blend_natively(
    gaussians: Gaussians, views: Views, channels: Float[Tensor, "v n c"]
) -> tuple[Float[Tensor, "v h w c"], Float[Tensor, "v h w"]]:
    """Draw each view with `rasterize` and stack the images."""
    drawn = [rasterize(gaussians, camera, own) for camera, own in zip(views.cameras, channels, strict=True)]
    return stacked([image for image, _ in drawn]), stacked([alpha for _, alpha in drawn])


NATIVE = Engine(name="cpu", device=CPU, blend=blend_natively, fused=True)


CUDA = Engine(name="cuda", device=FIRST, blend=blend_with_gsplat, fused=False)


def choose_engine(wanted: DeviceName, notify: Listener = ignore) -> Engine:
    """Choose the engine of a run: gsplat where CUDA is allowed and passes the trial, else the CPU; see `choose_device`.

    Raises:
        EngineError: cuda is wanted and does not work.
    """
    device = choose_device(wanted, lambda device: cuda_flaw(notify), notify)
    return NATIVE if device == CPU else CUDA


def cuda_flaw(notify: Listener = ignore) -> str | None:
    """Say in one line why splats cannot be drawn on a CUDA device; None where they can.

    It draws, because gsplat can be imported without its kernels and fails only when they are called.
    """
    if not torch.cuda.is_available():
        return "PyTorch sees no CUDA device"
    notify(Progress(stage="try gsplat", done=0, total=1))
    flaw = trial_flaw(blend_with_gsplat, FIRST)
    notify(Progress(stage="try gsplat", done=1, total=1))
    return flaw


def trial_flaw(blend: Blend, device: torch.device) -> str | None:
    """Draw a few splats into two views, with gradients, and compare the results with those of the CPU.

    Returns:
        What is wrong, in one line; None where values and gradients agree within 1 % of the largest.
    """
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # gsplat prints compiler messages to stdout
            found = _trial(blend, device)
    except ModuleNotFoundError as error:
        return f"{error.name} is not installed"
    except Exception as error:  # a broken toolchain can raise anything
        lines = str(error).splitlines() or [""]
        return f"a trial with {gsplat_version()} failed ({type(error).__name__}: {lines[0][:120]})"
    for name, expected in _trial(blend_natively, CPU).items():
        largest, off = expected.abs().max().item(), (found[name].cpu() - expected).abs().max().item()
        if not off <= _TOLERANCE * largest:
            return f"{gsplat_version()} draws other {name} than the processor (off by {off:.2g} of {largest:.2g})"
    return None


def gsplat_version() -> str:
    """Name and version of the installed gsplat, for example `gsplat 1.5.3`."""
    try:
        return f"gsplat {version('gsplat')}"
    except PackageNotFoundError:
        return "gsplat"


def _trial(blend: Blend, device: torch.device) -> dict[str, Tensor]:
    """Images of two views and gradients of every input, by name."""
    names = ("means", "quats", "log_scales", "opacity_logits")
    splats, channels = trial_splats(_SPLATS, _CHANNELS)
    splats = replace(splats, **{name: getattr(splats, name).to(device).requires_grad_() for name in names})
    channels = channels.to(device).requires_grad_()
    image, alpha = blend(splats, views_of(trial_cameras(), device), channels.expand(2, -1, -1))
    (image.square().sum() + alpha.square().sum()).backward()
    found = {"images": image.detach(), "alpha": alpha.detach(), "gradients of channels": channels.grad}
    return found | {f"gradients of {name}": getattr(splats, name).grad for name in names}


def trial_splats(count: int, channels: int) -> tuple[Gaussians, Float[Tensor, "n c"]]:
    """Random splats and channels in front of the trial's cameras; versions of gsplat differ for higher opacities."""
    generator = torch.Generator().manual_seed(0)
    places = torch.rand(count, 3, generator=generator) - 0.5
    splats = Gaussians(
        means=places * torch.tensor([2.6, 2.0, 1.6]) + torch.tensor([0.0, 0.0, 2.6]),
        quats=torch.randn(count, 4, generator=generator),
        log_scales=torch.randn(count, 3, generator=generator) * 0.5 - 2.0,
        opacity_logits=torch.randn(count, generator=generator).clamp(-2.5, 2.5),
        sh=torch.zeros(count, 1, 3),
    )
    return splats, torch.rand(count, channels, generator=generator)


def trial_cameras() -> list[Camera]:
    """Two cameras of one size, side by side, with the principal point off the middle of the image."""
    cameras = []
    for shift in (0.0, 0.25):
        pose = torch.eye(4)
        pose[0, 3] = shift
        focal, centre = torch.tensor([38.0, 41.0]), torch.tensor([19.3, 14.8])
        cameras.append(Camera(focal_px=focal, centre_px=centre, width=40, height=28, world_from_cam=pose))
    return cameras
