"""The scene as 3D Gaussians."""

from dataclasses import dataclass, fields
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
        chosen = {}
        for item in fields(self):
            value = getattr(self, item.name)
            chosen[item.name] = None if value is None else value[index]
        return Gaussians(**chosen)

    def to(self, device: torch.device) -> "Gaussians":
        """The same splats with their numbers on a device."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        return Gaussians(**{name: None if value is None else value.to(device) for name, value in values.items()})

    def __reduce__(self) -> tuple[Any, ...]:
        """Sent through the processor and back onto the device: a handle of its memory would die with the sender."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        sent = {name: None if value is None else value.detach().cpu() for name, value in values.items()}
        return _on_device, (sent, self.means.device)

    def detached(self) -> "Gaussians":
        """The same numbers outside any autograd graph."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        return Gaussians(**{name: None if value is None else value.detach() for name, value in values.items()})


def _on_device(values: dict[str, Tensor | None], device: torch.device) -> Gaussians:
    return Gaussians(**values).to(device)  # pyright: ignore[reportArgumentType]: only identity may be None
