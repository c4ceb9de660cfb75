"""Settings of the benchmark."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from goc.capture.config import SidePx
from goc.errors import ConfigError
from goc.settings import Count, CountOrNone, Settings

Suite = Literal["rooms", "completion", "sensors", "labels", "ablations", "paper", "osc-sizes", "masks", "shapes"]
OF_ROOMS: tuple[Suite, ...] = ("rooms", "completion", "sensors", "labels", "ablations", "paper")
OF_SHAPES: tuple[Suite, ...] = ("osc-sizes", "masks", "shapes")
SUITES: tuple[Suite, ...] = (*OF_ROOMS, *OF_SHAPES)
OscSize = Literal["S", "M", "L"]


@dataclass(frozen=True, kw_only=True)
class OscBenchConfig(Settings):
    """Networks that the paper's Tables 5 to 7 compare, and the shapes that they are scored on."""

    data: Path | None = None
    """Shapes that `goc osc prepare` made; left out: the suites osc-sizes, masks and shapes are not run."""
    steps: CountOrNone = 0
    """Steps that each network is trained for; 0: none is."""
    shapes: Count | None = None
    """Number of shapes that each is scored on; default: all of split val."""
    sizes: tuple[OscSize, ...] = ("S", "M", "L")
    """Sizes that are trained; masks takes the first, shapes the last."""

    def __post_init__(self) -> None:
        """Refuse tables without a network."""
        super().__post_init__()
        if not self.sizes:
            raise ConfigError("{sizes} names none. There are: S, M, L.", type(self))


@dataclass(frozen=True, kw_only=True)
class BenchConfig(Settings):
    """What is measured on what."""

    suites: tuple[Suite, ...] = SUITES
    """rooms: Tables 1 and 2. completion: exact depth, fused, then closed by the hull and by the network that goc ships.
    sensors: noisy, monocular and no depth. labels: clean and spoiled masks, voted, learned. ablations: Table 4, a loss
    left out at a time. paper: the paper's 30,000 steps; hours on two cores. osc-sizes, masks, shapes: Tables 5 to 7,
    networks of the paper's sizes, trained for --osc.steps and scored on --osc.data."""
    data: Path | None = None
    """Folder of rooms with ground truth (a folder each: transforms.json, transforms_sparse.json, gt/)."""
    rooms: tuple[str, ...] = ()
    """Which rooms of --data; default: all."""
    synth_rooms: CountOrNone = 1
    """Rooms that `goc synth` makes for the benchmark, beside those of --data."""
    ablation_rooms: tuple[str, ...] = ()
    """Rooms of the suites ablations and paper; default: the first."""
    ablation_views: Literal["full", "sparse"] = "sparse"
    """Views of the suites ablations and paper."""
    iterations: Count | None = None
    """Optimisation steps of every run except the paper's; default: the preset's."""
    max_side_px: SidePx | None = None
    """Scale views down to this; default: as `goc carve` does."""
    osc: OscBenchConfig = field(default_factory=OscBenchConfig)
    """Networks of the suites osc-sizes, masks and shapes."""
    fresh: bool = False
    """Measure again what is measured already."""

    def __post_init__(self) -> None:
        """Refuse a benchmark that measures nothing."""
        super().__post_init__()
        if not self.suites:
            raise ConfigError(f"{{suites}} names none. There are: {', '.join(SUITES)}.", type(self))
        if self.data is None and self.rooms:
            raise ConfigError("{rooms} chooses among the rooms of {data}, which is not given.", type(self))
        if self.data is None and not self.synth_rooms and set(self.suites) & set(OF_ROOMS):
            raise ConfigError("{synth_rooms} is 0, which leaves no rooms: needs 1 or more, or {data}.", type(self))
