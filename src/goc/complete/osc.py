"""The paper's completion model, §5.1: a set of points in, occupancy anywhere out, through a latent set of tokens."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from goc.complete.layers import FOURIER, CrossBlock, KeysValues, SelfBlock, fourier_features
from goc.complete.partial import PartialBatch, PartialObject, batch_of
from goc.complete.sampling import farthest_points


@dataclass(frozen=True, kw_only=True)
class OscConfig:
    """Depths and widths. Table 5 names depths alone; these widths give its S and M to 1 % (docs/decisions)."""

    encoder: int = 10
    """Cross-attention blocks of the encoder, and as many self-attention blocks."""
    decoder: int = 6
    """Self-attention blocks of the decoder, and as many cross-attention blocks."""
    width: int = 512
    """Width of every token outside the bottleneck."""
    heads: int = 8
    """Heads of every attention."""
    tokens: int = 2048
    """M: points that FPS takes as queries, and so tokens of the latent."""
    latent: int = 16
    """D: numbers a token keeps in the bottleneck."""
    points: int = 8192
    """Points of the partial surface that the encoder sees."""


SIZES = {
    "S": OscConfig(encoder=6, decoder=4),
    "M": OscConfig(encoder=10, decoder=6),
    "L": OscConfig(encoder=14, decoder=8),
    "L164": OscConfig(encoder=18, decoder=8),
}
"""63, 101 and 139 million parameters by the depths as printed; 164 million, as Table 5 says of L, takes 52 blocks."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Latent:
    """The distribution of the embedding E, token by token."""

    mean: Float[Tensor, "b m c"]
    log_variance: Float[Tensor, "b m c"]

    def sample(self) -> Float[Tensor, "b m c"]:
        """E_s, drawn so that gradients reach mean and variance (Kingma and Welling 2014)."""
        return self.mean + torch.randn_like(self.mean) * (0.5 * self.log_variance).exp()


class Osc(nn.Module):
    """Eq. (8) to (10). Encoder: FPS points meet all points, then each other. Decoder: tokens, then grid queries."""

    def __init__(self, config: OscConfig) -> None:
        super().__init__()
        self.config = config
        width, heads = config.width, config.heads
        self.embed = nn.Linear(FOURIER, width)
        self.encoder_cross = nn.ModuleList(CrossBlock(width, heads) for _ in range(config.encoder))
        self.encoder_self = nn.ModuleList(SelfBlock(width, heads) for _ in range(config.encoder))
        self.to_mean = nn.Linear(width, config.latent)
        self.to_log_variance = nn.Linear(width, config.latent)
        self.from_latent = nn.Linear(config.latent, width)
        self.decoder_self = nn.ModuleList(SelfBlock(width, heads) for _ in range(config.decoder))
        self.decoder_cross = nn.ModuleList(CrossBlock(width, heads) for _ in range(config.decoder))
        self.to_logit = nn.Sequential(nn.LayerNorm(width), nn.Linear(width, width), nn.GELU(), nn.Linear(width, 1))

    def encode(self, points: Float[Tensor, "b p 3"]) -> Latent:
        """E = SelfAttns(CrossAttns(FPE(FPS(P_s)), FPE(P_s))), Eq. (8), as mean and variance of each token."""
        rows = farthest_points(points, self.config.tokens)
        surface = self.embed(fourier_features(points))
        tokens = torch.take_along_dim(surface, rows[..., None], 1)
        for block in self.encoder_cross:
            tokens = block(tokens, block.keys_values(surface))
        for block in self.encoder_self:
            tokens = block(tokens)
        return Latent(mean=self.to_mean(tokens), log_variance=self.to_log_variance(tokens).clamp(-30.0, 20.0))

    def remember(self, latent: Float[Tensor, "b m c"]) -> list[KeysValues]:
        """SelfAttns(E_s), as keys and values for each cross-attention: computed once for any number of queries."""
        tokens = self.from_latent(latent)
        for block in self.decoder_self:
            tokens = block(tokens)
        return [block.keys_values(tokens) for block in self.decoder_cross]

    def decode(self, queries: Float[Tensor, "b q 3"], memory: list[KeysValues]) -> Float[Tensor, "b q"]:
        """MLP(CrossAttns(FPE(Q_g), SelfAttns(E_s))), Eq. (10): log-odds of occupancy."""
        found = self.embed(fourier_features(queries))
        for block, met in zip(self.decoder_cross, memory, strict=True):
            found = block(found, met)
        return self.to_logit(found)[..., 0]

    def forward(
        self, seen: PartialBatch, queries: Float[Tensor, "b q 3"]
    ) -> tuple[Float[Tensor, "b q"], Float[Tensor, ""]]:
        """Log-odds at the queries, and L_KL of Eq. (9): summed over a token's numbers, mean over tokens."""
        latent = self.encode(seen.points)
        spread = latent.log_variance.exp() + latent.mean.square() - 1.0 - latent.log_variance
        return self.decode(queries, self.remember(latent.sample())), 0.5 * spread.sum(-1).mean()

    @torch.inference_mode()
    def complete(self, partial: PartialObject) -> "OscField":
        """The field of one object, from the mean of its latent: the same each time."""
        device = self.embed.weight.device
        points = batch_of(partial, self.config.points, cells=1).points.to(device)
        return OscField(model=self, memory=self.remember(self.encode(points).mean))


@dataclass(frozen=True, kw_only=True, eq=False)
class OscField:
    """Occupancy of one object, with the keys and values of the decoder kept."""

    model: Osc
    memory: list[KeysValues]
    chunk: int = 16_384
    """Queries decoded at once."""

    @torch.inference_mode()
    def logits(self, points: Float[Tensor, "q 3"]) -> Float[Tensor, "q"]:
        """Log-odds of occupancy at points in [-1, 1]³."""
        device = self.memory[0][0].device
        parts = [self.model.decode(part[None].to(device), self.memory)[0] for part in points.split(self.chunk)]
        return torch.cat(parts).to(points.device) if parts else points.new_zeros(0)
