"""OSC-lite: the small model. Evidence on a grid in, occupancy anywhere out; made for two cores.

A small 3D U-Net (Çiçek et al. 2016) learns what surfaces do locally, a transformer at its coarsest level what objects
are like as a whole, and an MLP reads occupancy off features interpolated at any point (Peng et al. 2020).
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from goc.complete.hints import HINTS
from goc.complete.layers import SelfBlock
from goc.complete.partial import CHANNELS, PartialBatch, PartialObject, batch_of

Volume = Float[Tensor, "b c n n n"]


@dataclass(frozen=True, kw_only=True)
class LiteConfig:
    """Sizes. The grid is halved once before the first convolution, and once more a level."""

    cells: int = 48
    """Cells of the evidence grid along each side of the cube; a multiple of 8."""
    fine: int = 32
    """Channels at half of `cells`."""
    middle: int = 64
    """Channels at a quarter of `cells`."""
    width: int = 256
    """Width of the transformer's tokens, at an eighth of `cells`."""
    blocks: int = 6
    """Number of transformer blocks."""
    heads: int = 4
    """Heads of each attention."""
    hidden: int = 64
    """Width of the MLP that reads occupancy off the features."""
    hints: bool = False
    """Whether it takes HINTS beside CHANNELS; the weights of goc's first release do not."""

    @property
    def channels(self) -> int:
        """Channels of evidence that it takes."""
        return len(CHANNELS) + (len(HINTS) if self.hints else 0)


class Residual(nn.Module):
    """Two 3³ convolutions beside a shortcut."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.norm = nn.GroupNorm(8, channels)
        self.first = nn.Conv3d(channels, channels, 3, padding=1)
        self.second = nn.Conv3d(channels, channels, 3, padding=1)

    def forward(self, volume: Volume) -> Volume:
        """The volume with what its surroundings add to each cell."""
        return volume + self.second(functional.silu(self.first(functional.silu(self.norm(volume)))))


class Bottleneck(nn.Module):
    """A transformer over the cells of a coarse grid, each a token, so that distant places inform each other."""

    def __init__(self, cells: int, config: LiteConfig) -> None:
        super().__init__()
        self.place = nn.Parameter(torch.randn(1, cells**3, config.width) * 0.02)
        self.blocks = nn.Sequential(*(SelfBlock(config.width, config.heads) for _ in range(config.blocks)))
        self.norm = nn.LayerNorm(config.width)

    def forward(self, volume: Volume) -> Volume:
        """The grid, updated by attention between its cells."""
        tokens = self.norm(self.blocks(volume.flatten(2).transpose(1, 2) + self.place))
        return tokens.transpose(1, 2).unflatten(2, volume.shape[2:])


@dataclass(frozen=True, kw_only=True, eq=False)
class FeatureGrids:
    """Feature grids that fill the cube, fine to coarse; all of them are interpolated at a query."""

    volumes: tuple[Float[Tensor, "_ _ _ _ _"], ...]

    def at(self, points: Float[Tensor, "b q 3"]) -> Float[Tensor, "b q f"]:
        """Trilinear between cell centres, all grids side by side; beyond the outermost centres the border goes on."""
        where = points.flip(-1)[:, :, None, None]  # grid_sample counts the last axis first
        found = [
            functional.grid_sample(volume.float(), where, padding_mode="border", align_corners=False)
            for volume in self.volumes
        ]
        return torch.cat([one[..., 0, 0].transpose(1, 2) for one in found], -1)


class OscLite(nn.Module):
    """U-Net over evidence, transformer at its coarsest level, MLP over interpolated features."""

    def __init__(self, config: LiteConfig) -> None:
        super().__init__()
        self.config = config
        fine, middle, width = config.fine, config.middle, config.width
        self.stem = nn.Conv3d(config.channels, fine, 2, stride=2)
        self.encode_fine = Residual(fine)
        self.to_middle = nn.Conv3d(fine, middle, 2, stride=2)
        self.encode_middle = Residual(middle)
        self.to_coarse = nn.Conv3d(middle, width, 2, stride=2)
        self.bottleneck = Bottleneck(config.cells // 8, config)
        self.from_coarse = nn.ConvTranspose3d(width, middle, 2, stride=2)
        self.join_middle = nn.Conv3d(2 * middle, middle, 1)
        self.decode_middle = Residual(middle)
        self.from_middle = nn.ConvTranspose3d(middle, fine, 2, stride=2)
        self.join_fine = nn.Conv3d(2 * fine, fine, 1)
        self.decode_fine = Residual(fine)
        self.to_logit = nn.Sequential(
            nn.Linear(config.channels + fine + middle, config.hidden),
            nn.SiLU(),
            nn.Linear(config.hidden, config.hidden),
            nn.SiLU(),
            nn.Linear(config.hidden, 1),
        )

    def features(self, evidence: Volume) -> FeatureGrids:
        """Encode the evidence as feature grids; the evidence itself is the finest of them."""
        given = evidence.to(memory_format=torch.channels_last_3d)  # twice as fast as the default on CPUs (measured)
        fine = self.encode_fine(self.stem(given))
        middle = self.encode_middle(self.to_middle(fine))
        coarse = self.bottleneck(self.to_coarse(middle))
        middle = self.decode_middle(self.join_middle(torch.cat([middle, self.from_coarse(coarse)], 1)))
        fine = self.decode_fine(self.join_fine(torch.cat([fine, self.from_middle(middle)], 1)))
        return FeatureGrids(volumes=(evidence, fine, middle))

    def decode(self, features: FeatureGrids, queries: Float[Tensor, "b q 3"]) -> Float[Tensor, "b q"]:
        """Log-odds of occupancy at the queries."""
        return self.to_logit(features.at(queries))[..., 0].float()

    def forward(
        self, seen: PartialBatch, queries: Float[Tensor, "b q 3"]
    ) -> tuple[Float[Tensor, "b q"], Float[Tensor, ""]]:
        """Log-odds at the queries; the second is the paper's L_KL, 0 here: nothing is sampled."""
        return self.decode(self.features(seen.evidence), queries), queries.new_zeros(())

    @torch.inference_mode()
    def complete(self, partial: PartialObject) -> "LiteField":
        """The field of one object."""
        evidence = batch_of(partial, points=0, cells=self.config.cells, hints=self.config.hints).evidence
        return LiteField(model=self, features=self.features(evidence.to(self.stem.weight.device)))


@dataclass(frozen=True, kw_only=True, eq=False)
class LiteField:
    """Occupancy of one object, with the features kept."""

    model: OscLite
    features: FeatureGrids
    chunk: int = 65_536
    """Queries decoded at once."""

    @torch.inference_mode()
    def logits(self, points: Float[Tensor, "q 3"]) -> Float[Tensor, "q"]:
        """Log-odds of occupancy at points in [-1, 1]³."""
        device = self.features.volumes[0].device
        parts = [self.model.decode(self.features, part[None].to(device))[0] for part in points.split(self.chunk)]
        return torch.cat(parts).to(points.device) if parts else points.new_zeros(0)
