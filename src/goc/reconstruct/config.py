"""Settings of stage 2."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from goc.errors import ConfigError
from goc.settings import Amount, Count, CountOrNone, OpenShare, Positive, Range, Seed, Settings, Share


@dataclass(frozen=True)
class Multiview(Settings):
    """Which views L_pho and L_geo compare, and when."""

    start: Share = 0.2
    """First comparison, as a share of all steps, since early depths are too rough to compare."""
    neighbours: Count = 4
    """Most neighbours of a view; each step draws one of them. Loss weights of 0 switch the comparison off."""
    max_angle_deg: Annotated[float, Range(above=0, most=180)] = 35.0
    """Largest angle between the viewing directions of neighbours."""
    min_baseline: Amount = 0.05
    """Least distance between the cameras of neighbours, metres."""
    max_baseline: Positive = 1.5
    """Largest distance between the cameras of neighbours, metres."""
    tolerance: Annotated[float, Range(above=0, most=1)] = 0.05
    """Depths within this share of each other show one surface: what lies further behind is hidden."""
    neighbour_depth: Literal["cached", "rendered"] = "cached"
    """cached: the neighbour's depth as it was when that view was drawn last. rendered: draw it again, and let L_geo
    move both, at the price of a second view a step."""

    def __post_init__(self) -> None:
        """Refuse a range of distances that is empty."""
        super().__post_init__()
        if self.min_baseline >= self.max_baseline:
            text = (
                f"{{min_baseline}} is {self.min_baseline:g}: needs less than {{max_baseline}} ({self.max_baseline:g})."
            )
            raise ConfigError(text, type(self))


@dataclass(frozen=True)
class Monocular(Settings):
    """How depth of unknown scale and offset is aligned again while splats improve (depth kind affine or inverse)."""

    refresh_every: CountOrNone = 0
    """Epochs between fits of a view's scale and offset to the depth of the splats, as the paper has it. 0: only views
    that could not be aligned at the start are fitted, once. With more, splats and depth can drift together."""
    smoothing: Share = 0.5
    """Share of the old scale and offset that a new fit leaves."""


@dataclass(frozen=True)
class Losses(Settings):
    """Weights of the losses in Eq. (6), where 0 switches one off, and what they compare with."""

    ssim: Share = 0.2
    """Share of 1 - SSIM in the photometric loss L_c; the rest is L1."""
    depth: Amount = 1.0
    """L_d, Eq. (3): rendered against given depth, per metre. The paper has 0.3 (preset paper)."""
    depth_normal: Amount = 0.1
    """L_dn, Eq. (4): normals of the rendered depth against those of the given depth."""
    photometric: Amount = 0.3
    """L_pho, Eq. (5): a neighbour's photograph, fetched by the rendered depth, against the view's."""
    geometric: Amount = 0.0
    """L_geo: pixels carried to a neighbour's surface and back, against where they started (paper: 0.3)."""
    identity: Amount = 0.1
    """L_o: cross-entropy of learned instance features; only with labels = learned."""
    identity_every: Count = 1
    """Steps from one that renders features and has L_o to the next; there L_o weighs that many times as much."""
    multiview: Multiview = field(default_factory=Multiview)
    """Comparison of neighbouring views."""
    monocular: Monocular = field(default_factory=Monocular)
    """Aligning monocular depth again."""


@dataclass(frozen=True)
class LearningRates(Settings):
    """Adam's step sizes. Those of 3D Gaussian Splatting (preset paper) are for 30,000 steps; docs/decisions/0029."""

    means: Amount = 3.2e-4
    """Times the scene's extent; falls exponentially to means_final of itself."""
    means_final: Annotated[float, Range(above=0, most=1)] = 0.01
    """What is left of the rate of the means at the last step."""
    quats: Amount = 1e-3
    """Rotations."""
    log_scales: Amount = 5e-3
    """Sizes."""
    opacity_logits: Amount = 0.1
    """Opacities."""
    sh_constant: Amount = 5e-3
    """View-independent colour."""
    sh_rest: Amount = 1e-3
    """View-dependent colour."""
    identity: Amount = 2.5e-3
    """Instance features and their classifier."""


@dataclass(frozen=True)
class Mcmc(Settings):
    """Relocation, growth and noise after Kheradmand et al. (2024), "3DGS as Markov Chain Monte Carlo"."""

    max_splats: Annotated[int, Range(least=100)] = 80_000
    """The budget, or the pixels of a view where those are fewer. Seeds from depth start there, others grow to it.
    Half the pixels made no better held-out PSNR (demo: 26.0 for 26.1 dB), and small objects rougher."""
    every: Count = 100
    """Steps between relocations."""
    start: Share = 0.1
    """First relocation, as a share of all steps."""
    stop: Share = 0.8
    """No relocation and no noise after this share of all steps."""
    growth: Amount = 0.15
    """New splats a relocation, as a share of those there are."""
    min_opacity: Annotated[float, Range(least=0, below=1)] = 0.005
    """Splats below are dead and move to where live ones are."""
    noise: Amount = 5e5
    """Strength of the exploration noise, times the rate of the means."""
    opacity_penalty: Amount = 0.01
    """Pull of visible splats towards transparency."""
    scale_penalty: Amount = 0.01
    """Pull of visible splats towards smallness, per metre."""


@dataclass(frozen=True)
class SeedConfig(Settings):
    """Where the first splats come from."""

    random_points: Annotated[int, Range(least=100)] = 20_000
    """Points in the scene box, where a capture has neither depth nor points and its photographs match nowhere."""
    flatness: Annotated[float, Range(above=0, most=1)] = 0.15
    """Thickness over width of a seed splat with a known normal."""
    opacity: OpenShare = 0.8
    """Opacity of seeds on measured surface."""
    fill_share: Share = 0.2
    """Share of stereo's seeds that lie where no view is sure, on depth interpolated inside each view."""
    fill_opacity: OpenShare = 0.1
    """Opacity of those."""


@dataclass(frozen=True)
class ReconstructConfig(Settings):
    """How splats are optimised (paper §4)."""

    iterations: Count = 2000
    """Optimisation steps."""
    views_a_step: Count = 1
    """Views whose mean loss makes a step; a CUDA device draws them in one call."""
    sh_degree: Annotated[int, Range(least=0, most=3)] = 1
    """Degree of view-dependent colour, 0 to 3."""
    depth: Literal["plane", "expected"] = "plane"
    """Rendered depth that the losses see. plane: where rays meet the splats' planes. expected: of the splats' centres,
    Eq. (2) of the paper, which is biased towards the camera on slanted surfaces: docs/decisions/0005."""
    labels: Literal["votes", "learned"] = "votes"
    """votes: each splat takes the id whose pixels it colours most. learned: the paper's features, MLP and L_o."""
    holdout_every: CountOrNone = 10
    """Every n-th view is kept out of the optimisation and measures PSNR; 0 trains on all."""
    checkpoint_every: CountOrNone = 500
    """Steps between checkpoints, where there is a folder for them; 0: one at the end."""
    seed: Seed = 0
    """Random seed: the same seed gives the same bits on a CPU, for any number of threads."""
    seeding: SeedConfig = field(default_factory=SeedConfig)
    """First splats."""
    losses: Losses = field(default_factory=Losses)
    """Weights of the losses, and what they compare with."""
    rates: LearningRates = field(default_factory=LearningRates)
    """Step sizes."""
    mcmc: Mcmc = field(default_factory=Mcmc)
    """Relocation, growth and noise."""

    def __post_init__(self) -> None:
        """Refuse to hold out every view."""
        super().__post_init__()
        if self.holdout_every == 1:
            raise ConfigError(
                "{holdout_every} is 1, which leaves no view to learn from: needs 0, or 2 or more.", type(self)
            )
