"""Stage 2, Capture → Reconstruction: seed, losses, MCMC moves, optimisation, labels (paper §4)."""

from goc.reconstruct.config import (
    LearningRates,
    Losses,
    Mcmc,
    Monocular,
    Multiview,
    ReconstructConfig,
    SeedConfig,
)
from goc.reconstruct.labels import vote_labels
from goc.reconstruct.reconstruct import reconstruct, split_views

__all__ = [
    "LearningRates",
    "Losses",
    "Mcmc",
    "Monocular",
    "Multiview",
    "ReconstructConfig",
    "SeedConfig",
    "reconstruct",
    "split_views",
    "vote_labels",
]
