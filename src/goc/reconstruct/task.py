"""What an optimisation works on, and its randomness."""

import hashlib
from dataclasses import asdict, dataclass

import msgspec
import torch

from goc.device import CPU
from goc.raster import Engine
from goc.reconstruct.config import ReconstructConfig
from goc.reconstruct.geometry_prior import ViewPrior
from goc.reconstruct.pairs import Pairs
from goc.scene.capture import Capture


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """What is optimised against what."""

    capture: Capture
    views: list[int]
    """Training views."""
    names: list[int]
    """Ids that the classifier tells apart; empty when labels are voted."""
    extent: float
    """Radius of the cameras' positions, scene units: the scale of the means' step."""
    budget: int
    """Most splats there may be."""
    pairs: Pairs | None
    """Views to compare with each other, where a loss asks for them."""
    prior: ViewPrior
    """Geometry that a view is compared with; None where it has none."""
    config: ReconstructConfig
    engine: Engine
    """What draws; a run may go on with another one."""

    def fingerprint(self) -> str:
        """Names the capture and all settings: a checkpoint fits only the same."""
        capture = self.capture
        described = {
            "config": asdict(self.config),
            "views": [capture.view_names[view] for view in self.views],
            "priors": "" if capture.priors is None else capture.priors.settings,
            "alignment": "" if capture.alignment is None else capture.alignment.settings,
        }
        return hashlib.sha256(msgspec.json.encode(described, order="sorted")).hexdigest()


def generator_of(config: ReconstructConfig, *path: int, device: torch.device = CPU) -> torch.Generator:
    """Randomness of one moment: it depends on the seed and the step alone, so that a resumed run repeats it."""
    digest = hashlib.sha256(repr((config.seed, *path)).encode()).digest()
    return torch.Generator(device).manual_seed(int.from_bytes(digest[:7], "little"))
