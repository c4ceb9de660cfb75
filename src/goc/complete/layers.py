"""The blocks that both completion networks are made of."""

import math

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

OCTAVES = 8
FOURIER = 3 + 3 * 2 * OCTAVES
"""Features of a position: itself, and sine and cosine of 8 octaves along each axis."""


def fourier_features(points: Float[Tensor, "*b p 3"]) -> Float[Tensor, "*b p f"]:
    """Positional encoding FPE (Mildenhall et al. 2020): x, sin(π 2^k x), cos(π 2^k x), k = 0 … 7; 51 numbers."""
    octaves = math.pi * 2.0 ** torch.arange(OCTAVES, dtype=points.dtype, device=points.device)
    angles = (points[..., None] * octaves).flatten(-2)
    return torch.cat([points, angles.sin(), angles.cos()], -1)


KeysValues = tuple[Float[Tensor, "b h s k"], Float[Tensor, "b h s k"]]
"""Keys and values of s tokens, by head: all that a cross-attention needs of what it attends to."""


class Attention(nn.Module):
    """Multi-head attention (Vaswani et al. 2017) whose keys and values can be made once and kept."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.query = nn.Linear(width, width)
        self.key = nn.Linear(width, width)
        self.value = nn.Linear(width, width)
        self.out = nn.Linear(width, width)

    def keys_values(self, tokens: Float[Tensor, "b s d"]) -> KeysValues:
        """Keys and values of the tokens, by head."""
        return self._by_head(self.key(tokens)), self._by_head(self.value(tokens))

    def forward(self, queries: Float[Tensor, "b q d"], met: KeysValues) -> Float[Tensor, "b q d"]:
        """Each query's mean of the values, weighted by how well the keys fit."""
        mean = functional.scaled_dot_product_attention(self._by_head(self.query(queries)), *met)
        return self.out(mean.transpose(1, 2).flatten(2))

    def _by_head(self, tokens: Float[Tensor, "b s d"]) -> Float[Tensor, "b h s k"]:
        return tokens.unflatten(-1, (self.heads, -1)).transpose(1, 2)


class _FeedForward(nn.Sequential):
    def __init__(self, width: int) -> None:
        super().__init__(nn.LayerNorm(width), nn.Linear(width, 4 * width), nn.GELU(), nn.Linear(4 * width, width))


class CrossBlock(nn.Module):
    """Pre-norm cross-attention and MLP: queries learn from tokens."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.queries_norm = nn.LayerNorm(width)
        self.tokens_norm = nn.LayerNorm(width)
        self.attention = Attention(width, heads)
        self.feed_forward = _FeedForward(width)

    def keys_values(self, tokens: Float[Tensor, "b s d"]) -> KeysValues:
        """Keys and values of the tokens for this block; independent of the queries, so they can be computed once."""
        return self.attention.keys_values(self.tokens_norm(tokens))

    def forward(self, queries: Float[Tensor, "b q d"], met: KeysValues) -> Float[Tensor, "b q d"]:
        """The queries, updated by attention to the tokens whose keys and values are given."""
        queries = queries + self.attention(self.queries_norm(queries), met)
        return queries + self.feed_forward(queries)


class SelfBlock(nn.Module):
    """Pre-norm self-attention and MLP: tokens learn from each other."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.attention = Attention(width, heads)
        self.feed_forward = _FeedForward(width)

    def forward(self, tokens: Float[Tensor, "b s d"]) -> Float[Tensor, "b s d"]:
        """The tokens, updated by attention to each other."""
        normed = self.norm(tokens)
        tokens = tokens + self.attention(normed, self.attention.keys_values(normed))
        return tokens + self.feed_forward(tokens)
