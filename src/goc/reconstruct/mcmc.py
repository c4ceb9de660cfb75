"""Relocation, growth and noise of 3DGS as Markov Chain Monte Carlo (Kheradmand et al. 2024)."""

import math

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from goc.geometry.rotations import matrices_of_quats
from goc.reconstruct import kernels
from goc.reconstruct.schedule import means_rate
from goc.reconstruct.state import State
from goc.reconstruct.task import Task, generator_of

_EXPLORING = math.log(0.1 / 0.9)
"""Logit of 0.1: splats more opaque than that would move by less than 1e-4 of what a transparent one does. They are left
alone."""
_MAX_COPIES = 51
_BINOMIALS = torch.tensor(
    [[float(math.comb(n, k)) for k in range(_MAX_COPIES + 1)] for n in range(_MAX_COPIES + 1)], dtype=torch.float64
)


@torch.no_grad()
def move(task: Task, state: State) -> None:
    """What follows a step of Adam: exploration noise each time; relocation and growth now and then."""
    config, step = task.config, state.step
    mcmc, share = config.mcmc, (step + 1) / config.iterations
    if not mcmc.start <= share <= mcmc.stop:
        return
    generator = generator_of(config, 2, step, device=task.engine.device)
    if (step + 1) % mcmc.every == 0:
        relocate(state, mcmc.min_opacity, generator)
        densify(state, min(task.budget, math.ceil(state.splats * (1 + mcmc.growth))), mcmc.min_opacity, generator)
    explore(state, mcmc.noise * means_rate(task, step), generator)


def explore(state: State, strength: float, generator: torch.Generator) -> None:
    """Shake the means of splats that are nearly transparent."""
    p = state.parameters
    logits = p["opacity_logits"]
    # To find these rows is to wait for a device; there it is cheaper to move all of them.
    rows = torch.nonzero(logits < _EXPLORING)[:, 0] if kernels.natively(logits) else slice(None)
    opacities = logits[rows].sigmoid()
    p["means"][rows] += exploration_noise(p["log_scales"][rows], p["quats"][rows], opacities, strength, generator)


def relocate(state: State, min_opacity: float, generator: torch.Generator) -> None:
    """Move dead splats to live ones drawn by opacity; all copies together look like the one they replace."""
    opacities = state.parameters["opacity_logits"].sigmoid()
    dead = torch.nonzero(opacities <= min_opacity)[:, 0]
    alive = torch.nonzero(opacities > min_opacity)[:, 0]
    if len(dead) == 0 or len(alive) == 0:
        return
    targets = alive[drawn_by_opacity(opacities[alive], len(dead), generator)]
    _divide(state, targets, min_opacity)
    for name in state.per_splat:
        state.parameters[name][dead] = state.parameters[name][targets]
    state.forget(dead)


def densify(state: State, wanted: int, min_opacity: float, generator: torch.Generator) -> None:
    """Add splats up to `wanted`, as copies of live ones drawn by opacity."""
    count = wanted - state.splats
    if count <= 0:
        return
    targets = drawn_by_opacity(state.parameters["opacity_logits"].sigmoid(), count, generator)
    _divide(state, targets, min_opacity)
    state.resize(torch.cat([torch.arange(state.splats, device=targets.device), targets]))


def _divide(state: State, targets: Tensor, min_opacity: float) -> None:
    """Give each target the opacity and size of one of its copies, itself included."""
    rows, counts = torch.unique(targets, return_counts=True)
    logits, log_scales = state.parameters["opacity_logits"], state.parameters["log_scales"]
    opacities, scales = copy_values(logits[rows].sigmoid(), log_scales[rows].exp(), counts + 1)
    logits[rows] = torch.logit(opacities.clamp(min_opacity, 1 - 1e-6))
    log_scales[rows] = scales.log()
    state.forget(rows)


def copy_values(
    opacities: Float[Tensor, "m"], scales: Float[Tensor, "m 3"], copies: Int64[Tensor, "m"]
) -> tuple[Float[Tensor, "m"], Float[Tensor, "m 3"]]:
    """Opacity and scales of each of `copies` splats that together look like the one they replace (their Eq. 9).

    o' = 1 - (1 - o)^(1/n), and scale' = scale · o / S with S = Σ_{k=1…n} C(n, k) (-1)^(k-1) o'^k / √k, which is the
    paper's double sum with its inner sum in closed form. In float64: S alternates.
    """
    copies = copies.clamp(1, _MAX_COPIES)
    new = 1.0 - (1.0 - opacities.double()) ** (1.0 / copies)
    binomials = _BINOMIALS.to(copies.device)
    total = torch.zeros_like(new)
    for k in range(1, _MAX_COPIES + 1):
        total += binomials[copies, k] * (-1) ** (k - 1) * new**k / math.sqrt(k)
    shrink = opacities.double() / total
    return new.float(), (scales * shrink[:, None]).float()


def drawn_by_opacity(opacities: Float[Tensor, "n"], count: int, generator: torch.Generator) -> Int64[Tensor, "count"]:
    """Indices of `count` splats, drawn with replacement in proportion to their opacity."""
    return torch.multinomial(opacities, count, replacement=True, generator=generator)


def exploration_noise(
    log_scales: Float[Tensor, "n 3"],
    quats: Float[Tensor, "n 4"],
    opacities: Float[Tensor, "n"],
    strength: float,
    generator: torch.Generator,
) -> Float[Tensor, "n 3"]:
    """Noise of the means, Σ·ε·σ(100·((1 - o) - 0.995))·strength: it moves only splats that are nearly transparent."""
    gate = torch.sigmoid(100.0 * ((1.0 - opacities) - 0.995))
    noise = torch.randn(log_scales.shape, generator=generator, device=log_scales.device) * (gate * strength)[:, None]
    rotations = matrices_of_quats(quats)
    along = torch.einsum("nji,nj->ni", rotations, noise) * torch.exp(2.0 * log_scales)
    return torch.einsum("nij,nj->ni", rotations, along)
