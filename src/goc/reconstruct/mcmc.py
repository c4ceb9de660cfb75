"""Relocation, growth and noise of 3DGS as Markov Chain Monte Carlo (Kheradmand et al. 2024)."""

import math

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from goc.geometry.rotations import matrices_of_quats

_MAX_COPIES = 51
_BINOMIALS = torch.tensor(
    [[float(math.comb(n, k)) for k in range(_MAX_COPIES + 1)] for n in range(_MAX_COPIES + 1)], dtype=torch.float64
)


def relocated(
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


def draw(opacities: Float[Tensor, "n"], count: int, generator: torch.Generator) -> Int64[Tensor, "count"]:
    """Indices of `count` splats, drawn with replacement in proportion to their opacity."""
    return torch.multinomial(opacities, count, replacement=True, generator=generator)


def exploration(
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
