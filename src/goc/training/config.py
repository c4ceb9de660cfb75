"""Settings of `goc osc train`."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from goc.complete import SIZES, LiteConfig, OscConfig
from goc.errors import ConfigError
from goc.training.losses import LossConfig
from goc.training.masking import MaskConfig
from goc.training.samples import LoaderConfig

Size = Literal["lite", "S", "M", "L", "L164"]


@dataclass(frozen=True, kw_only=True)
class OptimiserConfig:
    """AdamW, warm-up, linear decay to nothing at the end of the budget."""

    rate: float = 1e-3
    """Learning rate after warm-up. The paper's 1e-4 suits its own sizes."""
    warmup: float = 0.02
    """Share of the budget in which the rate rises from 0."""
    decay: float = 0.01
    """Weight decay."""
    clip: float = 1.0
    """Largest norm of the gradient."""
    ema_decay: float = 0.999
    """Share of the old weights in the running mean that is used in the end; less in the first steps."""
    bf16: bool = True
    """Multiply in bfloat16: twice as fast on CPUs that can (measured), and on GPUs."""


@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """What is trained, on what, for how long."""

    size: Size = "lite"
    """Network: lite, or a size of the paper's model."""
    data: Path | None = None
    """Folder of `goc osc prepare`; none: procedural shapes alone."""
    minutes: float = 180.0
    """Budget of training time, earlier runs of the same training counted in."""
    steps: int | None = None
    """Budget in steps instead."""
    workers: int = 1
    """Processes that make batches; 0 makes them between steps."""
    save_every: float = 60.0
    """Seconds between checkpoints."""
    validate_every: int = 500
    """Steps between pictures and scores on fixed held-out masks."""
    seed: int = 0
    """Of weights, shapes, masks and samples."""
    loader: LoaderConfig = field(default_factory=LoaderConfig)
    masking: MaskConfig = field(default_factory=MaskConfig)
    losses: LossConfig = field(default_factory=LossConfig)
    optimiser: OptimiserConfig = field(default_factory=OptimiserConfig)

    def __post_init__(self) -> None:
        """Refuse budgets that mean nothing."""
        if self.steps is not None and self.steps < 1:
            raise ConfigError(f"--steps is {self.steps}: needs 1 or more.")
        if not self.minutes > 0:
            raise ConfigError(f"--minutes is {self.minutes}: needs more than 0.")

    def network(self) -> OscConfig | LiteConfig:
        """Sizes of the network."""
        return LiteConfig() if self.size == "lite" else SIZES[self.size]
