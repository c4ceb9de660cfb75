"""The optimisation of paper §4.4: one view a step, Eq. (6), Adam, MCMC moves."""

import hashlib
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import msgspec
import torch
from jaxtyping import Float
from torch import Tensor

from goc.errors import ReconstructError
from goc.events import Listener, Progress
from goc.geometry.harmonics import colours_towards
from goc.geometry.rays import pixel_rays
from goc.raster import centre_depths, plane_channels, rasterize
from goc.reconstruct.config import ReconstructConfig
from goc.reconstruct.labels import classify
from goc.reconstruct.losses import (
    GeometryPrior,
    expected_depth,
    geometry_loss,
    identity_loss,
    photometric_loss,
    planes_depth,
)
from goc.reconstruct.mcmc import draw, exploration, relocated
from goc.reconstruct.state import State, load_checkpoint, save_checkpoint
from goc.scene.capture import Capture, Frame

_IDENTITY_PIXELS = 16_384
"""Pixels a step whose features are classified: all of them would make the MLP dearer than the view."""

_EXPLORING = 0.1
"""Splats more opaque than this would move by less than 1e-4 of what a transparent one does: they are left alone."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """What is optimised against what."""

    capture: Capture
    views: list[int]
    """Training views."""
    names: list[int]
    """Ids that the classifier tells apart; empty when labels are voted."""
    extent: float
    """Radius of the cameras' positions, scene units: the scale of the means' step."""
    budget: int
    """Most splats there may be."""
    prior: Callable[[int], GeometryPrior | None]
    """Geometry that a view is compared with; None where it has none."""
    config: ReconstructConfig

    def fingerprint(self) -> str:
        """Names the capture and all settings: a checkpoint fits only the same."""
        described = {"config": asdict(self.config), "views": [self.capture.names[view] for view in self.views]}
        return hashlib.sha256(msgspec.json.encode(described, order="sorted")).hexdigest()


def optimise(task: Task, begin: Callable[[], State], notify: Listener, checkpoint: Path | None, resume: bool) -> State:
    """Run all steps, or those after the checkpoint; the result does not depend on where it was interrupted.

    Raises:
        ReconstructError: the loss of a view is not finite, or the checkpoint belongs to something else.
    """
    config = task.config
    state = load_checkpoint(checkpoint, task.fingerprint()) if checkpoint and resume else begin()
    shown_psnr = math.nan
    while state.step < config.iterations:
        view = _view_of(task, state.step)
        loss, psnr = _loss(task, state, view)
        if not math.isfinite(loss.item()):
            raise ReconstructError(
                f"{task.capture.names[view]}: the loss is not finite at step {state.step}. "
                "Check this view's depth and pose, or lower --reconstruct.rates."
            )
        loss.backward()
        _add_penalties(state, config)
        state.adam(_rates(task, state.step))
        _move(task, state)
        state.step += 1
        shown_psnr = psnr if math.isnan(shown_psnr) else 0.95 * shown_psnr + 0.05 * psnr
        figures = {"PSNR dB": shown_psnr, "splats": float(state.splats)}
        notify(Progress(stage="reconstruct", done=state.step, total=config.iterations, figures=figures))
        due = config.checkpoint_every and state.step % config.checkpoint_every == 0
        if checkpoint and (due or state.step == config.iterations):
            save_checkpoint(checkpoint, state, task.fingerprint())
    return state


def _generator(config: ReconstructConfig, *path: int) -> torch.Generator:
    """Randomness of one moment: it depends on the seed and the step alone, so that a resumed run repeats it."""
    digest = hashlib.sha256(repr((config.seed, *path)).encode()).digest()
    return torch.Generator().manual_seed(int.from_bytes(digest[:7], "little"))


def _view_of(task: Task, step: int) -> int:
    """Every view once an epoch, in a new order each time."""
    epoch, place = divmod(step, len(task.views))
    order = torch.randperm(len(task.views), generator=_generator(task.config, 0, epoch))
    return task.views[int(order[place])]


def _rates(task: Task, step: int) -> dict[str, float]:
    rates = task.config.rates
    share = step / max(1, task.config.iterations)
    found = {
        "means": rates.means * task.extent * rates.means_final**share,
        "quats": rates.quats,
        "log_scales": rates.log_scales,
        "opacity_logits": rates.opacity_logits,
        "sh_constant": rates.sh_constant,
        "sh_rest": rates.sh_rest,
        "identity": rates.identity,
    }
    return found | {f"classifier.{name}": rates.identity for name in _classifier_names(task)}


def _classifier_names(task: Task) -> list[str]:
    return ["hidden_weight", "hidden_bias", "class_weight", "class_bias"] if task.names else []


def _loss(task: Task, state: State, view: int) -> tuple[Float[Tensor, ""], float]:
    """Eq. (6) of one view, and its PSNR in dB."""
    frame = task.capture[view]
    weights, camera, gaussians = task.config.losses, frame.camera, state.gaussians()
    planes = task.config.depth == "plane"
    channels = [
        colours_towards(gaussians.sh, gaussians.means, camera.position),
        plane_channels(gaussians, camera) if planes else centre_depths(gaussians, camera)[:, None],
    ]
    if gaussians.identity is not None:
        channels.append(gaussians.identity)
    blended, alpha = rasterize(gaussians, camera, torch.cat(channels, -1))
    image, geometry, *features = blended.split([part.shape[1] for part in channels], -1)
    target = frame.image.float() / 255.0
    loss = photometric_loss(image, target, weights.ssim)
    prior = task.prior(view)
    if prior is not None and (weights.depth or weights.depth_normal):
        depth = planes_depth(geometry, alpha, pixel_rays(camera)) if planes else expected_depth(geometry[..., 0], alpha)
        loss = loss + geometry_loss(depth, prior, camera, weights.depth / task.capture.unit, weights.depth_normal)
    if gaussians.identity is not None and frame.ids is not None and weights.identity:
        loss = loss + weights.identity * _identity_loss(task, state, features[0], frame)
    error = (image.detach().clamp(0, 1) - target).square().mean().clamp_min(1e-10)
    return loss, -10.0 * math.log10(error.item())


def _identity_loss(task: Task, state: State, features: Float[Tensor, "h w f"], frame: Frame) -> Float[Tensor, ""]:
    assert frame.ids is not None
    classes = torch.full_like(frame.ids, -1)
    for place, name in enumerate(task.names):
        classes[frame.ids == name] = place
    pixels = torch.randint(0, classes.numel(), (_IDENTITY_PIXELS,), generator=_generator(task.config, 1, state.step))
    classifier = {name: state.parameters[f"classifier.{name}"] for name in _classifier_names(task)}
    logits = classify(features.reshape(-1, features.shape[-1])[pixels], classifier)
    return identity_loss(logits, classes.reshape(-1)[pixels])


@torch.no_grad()
def _add_penalties(state: State, config: ReconstructConfig) -> None:
    """Pull the opacity and size of the splats in view down; unseen splats would melt away (measured: gsplat #778)."""
    logits, log_scales = state.parameters["opacity_logits"], state.parameters["log_scales"]
    if logits.grad is None or log_scales.grad is None:
        return
    seen = (logits.grad != 0).float()
    count = seen.sum().clamp_min(1)
    opacities = logits.sigmoid()
    logits.grad += config.mcmc.opacity_penalty / count * seen * opacities * (1 - opacities)
    log_scales.grad += config.mcmc.scale_penalty / (3 * count) * seen[:, None] * log_scales.exp()


@torch.no_grad()
def _move(task: Task, state: State) -> None:
    """Exploration noise after every step; relocation and growth now and then."""
    config, step = task.config, state.step
    mcmc, share = config.mcmc, (step + 1) / config.iterations
    if not mcmc.start <= share <= mcmc.stop:
        return
    generator = _generator(config, 2, step)
    if (step + 1) % mcmc.every == 0:
        _relocate(state, mcmc.min_opacity, generator)
        _grow(state, min(task.budget, math.ceil(state.splats * (1 + mcmc.growth))), mcmc.min_opacity, generator)
    p = state.parameters
    strength = mcmc.noise * _rates(task, step)["means"]
    opacities = p["opacity_logits"].sigmoid()
    rows = torch.nonzero(opacities < _EXPLORING)[:, 0]
    p["means"][rows] += exploration(p["log_scales"][rows], p["quats"][rows], opacities[rows], strength, generator)


def _relocate(state: State, min_opacity: float, generator: torch.Generator) -> None:
    """Move dead splats to live ones drawn by opacity; all copies together look like the one they replace."""
    opacities = state.parameters["opacity_logits"].sigmoid()
    dead = torch.nonzero(opacities <= min_opacity)[:, 0]
    alive = torch.nonzero(opacities > min_opacity)[:, 0]
    if len(dead) == 0 or len(alive) == 0:
        return
    targets = alive[draw(opacities[alive], len(dead), generator)]
    _share(state, targets, min_opacity)
    for name in state.per_splat:
        state.parameters[name][dead] = state.parameters[name][targets]
    state.forget(dead)


def _grow(state: State, wanted: int, min_opacity: float, generator: torch.Generator) -> None:
    """Add splats as copies of live ones drawn by opacity."""
    count = wanted - state.splats
    if count <= 0:
        return
    targets = draw(state.parameters["opacity_logits"].sigmoid(), count, generator)
    _share(state, targets, min_opacity)
    state.resize(torch.cat([torch.arange(state.splats), targets]))


def _share(state: State, targets: Tensor, min_opacity: float) -> None:
    """Give each target the opacity and size of one of its copies, itself included."""
    rows, counts = torch.unique(targets, return_counts=True)
    logits, log_scales = state.parameters["opacity_logits"], state.parameters["log_scales"]
    opacities, scales = relocated(logits[rows].sigmoid(), log_scales[rows].exp(), counts + 1)
    logits[rows] = torch.logit(opacities.clamp(min_opacity, 1 - 1e-6))
    log_scales[rows] = scales.log()
    state.forget(rows)
