"""Settings of `goc osc train`."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from goc.complete import SIZES, LiteConfig, OscConfig
from goc.settings import Amount, Count, Positive, Range, Seed, Settings, Share
from goc.training.losses import LossConfig
from goc.training.masking import MaskConfig
from goc.training.samples import LoaderConfig

Size = Literal["lite", "S", "M", "L", "L164"]


@dataclass(frozen=True, kw_only=True)
class OptimiserConfig(Settings):
    """AdamW with warm-up and linear decay of the learning rate to 0 at the end of the budget."""

    rate: Positive = 1e-3
    """Learning rate after warm-up. The paper's 1e-4 suits its own sizes."""
    warmup: Share = 0.02
    """Share of the budget in which the rate rises from 0."""
    decay: Amount = 0.01
    """Weight decay."""
    clip: Positive = 1.0
    """Largest norm of the gradient."""
    ema_decay: Annotated[float, Range(least=0, below=1)] = 0.999
    """Decay of the exponential moving average of the weights, which is what gets saved; lower in the first steps."""
    bf16: bool = True
    """Multiply in bfloat16: twice as fast on CPUs that can (measured), and on GPUs. CPUs that would have to imitate it,
    at twenty times the price (measured), multiply in float32 all the same."""


@dataclass(frozen=True, kw_only=True)
class TrainConfig(Settings):
    """What to train, on which shapes, and for how long."""

    size: Size = "lite"
    """Network: lite, or a size of the paper's model."""
    data: Path | None = None
    """Folder of `goc osc prepare`; none: procedural shapes alone."""
    init: Path | None = None
    """Weights to begin with, which may lack hints; none: from nothing."""
    minutes: Positive = 180.0
    """Budget of training time, earlier runs of the same training counted in."""
    steps: Count | None = None
    """Budget in steps instead."""
    save_every: Amount = 60.0
    """Seconds between checkpoints."""
    validate_every: Count = 500
    """Steps between validations on fixed shapes that are not trained on."""
    seed: Seed = 0
    """Seed of weights, shapes, masks and samples."""
    loader: LoaderConfig = field(default_factory=LoaderConfig)
    masking: MaskConfig = field(default_factory=MaskConfig)
    losses: LossConfig = field(default_factory=LossConfig)
    optimiser: OptimiserConfig = field(default_factory=OptimiserConfig)

    def network(self) -> OscConfig | LiteConfig:
        """Sizes of the network."""
        return LiteConfig(hints=True) if self.size == "lite" else SIZES[self.size]
