"""The scene as 3D Gaussians."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True, kw_only=True, eq=False)
class Gaussians:
    """n splats, parameterised as in 3D Gaussian Splatting (Kerbl et al. 2023), paper §4.1."""

    means: Float[Tensor, "n 3"]
    """World, metres."""
    quats: Float[Tensor, "n 4"]
    """Rotation world from splat axes, wxyz; any non-zero length."""
    log_scales: Float[Tensor, "n 3"]
    """Natural logarithm of the standard deviations along the splat's axes, metres."""
    opacity_logits: Float[Tensor, "n"]
    sh: Float[Tensor, "n k 3"]
    """Real spherical harmonics of colour, k = (degree + 1)²; colour = 0.5 + Σ sh·Y, sRGB."""
    identity: Float[Tensor, "n f"] | None = None
    """Instance features f of Eq. (7), where they are learned."""

    def __len__(self) -> int:
        return self.means.shape[0]

    @property
    def sh_degree(self) -> int:
        """Degree of the colour's spherical harmonics."""
        return round(self.sh.shape[1] ** 0.5) - 1

    def __getitem__(self, index: Tensor) -> "Gaussians":
        """The splats that a boolean mask or an index tensor selects."""
        return self._each(lambda value: value[index])

    def to(self, device: torch.device) -> "Gaussians":
        """The same splats with their numbers on a device."""
        return self._each(lambda value: value.to(device))

    def __reduce__(self) -> tuple[Any, ...]:
        """Sent through the processor and back onto the device: a handle of its memory would die with the sender."""
        return _on_device, (vars(self._each(lambda value: value.detach().cpu())), self.means.device)

    def detached(self) -> "Gaussians":
        """The same numbers outside any autograd graph."""
        return self._each(Tensor.detach)

    def _each(self, change: Callable[[Tensor], Tensor]) -> "Gaussians":
        return Gaussians(
            means=change(self.means),
            quats=change(self.quats),
            log_scales=change(self.log_scales),
            opacity_logits=change(self.opacity_logits),
            sh=change(self.sh),
            identity=None if self.identity is None else change(self.identity),
        )


def _on_device(values: dict[str, Any], device: torch.device) -> Gaussians:
    return Gaussians(**values).to(device)
