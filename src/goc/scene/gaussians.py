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
    """Centres, world, scene units."""
    quats: Float[Tensor, "n 4"]
    """Rotations from splat axes to the world as quaternions wxyz of any length but 0."""
    log_scales: Float[Tensor, "n 3"]
    """Natural logarithms of the standard deviations along the splat's axes, scene units."""
    opacity_logits: Float[Tensor, "n"]
    """Opacity is the sigmoid of these."""
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
        """Select splats with a boolean mask or an index tensor."""
        return self._each(lambda value: value[index])

    def to(self, device: torch.device) -> "Gaussians":
        """Return the splats on a device."""
        return self._each(lambda value: value.to(device))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle through the CPU and unpickle on the device: a handle of device memory would end with the sender."""
        return _on_device, (vars(self._each(lambda value: value.detach().cpu())), self.means.device)

    def detached(self) -> "Gaussians":
        """Return the splats outside any autograd graph, sharing memory."""
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
