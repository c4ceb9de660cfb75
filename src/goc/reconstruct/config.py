"""Settings of stage 2."""

from dataclasses import dataclass, field
from typing import Literal

from goc.errors import ConfigError
from goc.priors.config import StereoConfig
from goc.raster import EngineName


@dataclass(frozen=True)
class LossWeights:
    """Weights of Eq. (6); 0 switches a loss off."""

    ssim: float = 0.2
    """Share of 1 - SSIM in the photometric loss L_c; the rest is L1."""
    depth: float = 1.0
    """L_d, Eq. (3): rendered against given depth, per metre. The paper has 0.3 (preset paper)."""
    depth_normal: float = 0.1
    """L_dn, Eq. (4): normals of the rendered depth against those of the given depth."""
    photometric: float = 0.3
    """L_pho, Eq. (5): a neighbour's photograph, fetched by the rendered depth, against the view's."""
    geometric: float = 0.0
    """L_geo: pixels carried to a neighbour's surface and back, against where they started (paper: 0.3)."""
    identity: float = 0.1
    """L_o: cross-entropy of learned instance features; only with labels = learned."""
    identity_every: int = 1
    """Steps from one that renders features and has L_o to the next; there L_o weighs that many times as much."""

    def __post_init__(self) -> None:
        if self.identity_every < 1:
            raise ConfigError(f"--reconstruct.losses.identity-every is {self.identity_every}: needs 1 or more.")


@dataclass(frozen=True)
class LearningRates:
    """Adam's step sizes. Those of 3D Gaussian Splatting (preset paper) are for 30,000 steps; docs/decisions/0029."""

    means: float = 3.2e-4
    """Times the scene's extent; falls exponentially to means_final of itself."""
    means_final: float = 0.01
    """What is left of the rate of the means at the last step."""
    quats: float = 1e-3
    """Rotations."""
    log_scales: float = 5e-3
    """Sizes."""
    opacity_logits: float = 0.1
    """Opacities."""
    sh_constant: float = 5e-3
    """View-independent colour."""
    sh_rest: float = 1e-3
    """View-dependent colour."""
    identity: float = 2.5e-3
    """Instance features and their classifier."""


@dataclass(frozen=True)
class Mcmc:
    """Relocation, growth and noise after Kheradmand et al. (2024), "3DGS as Markov Chain Monte Carlo"."""

    max_splats: int = 80_000
    """The budget, or the pixels of a view where those are fewer. Seeds from depth start there, others grow to it.
    Half the pixels made no better held-out PSNR (demo: 26.0 for 26.1 dB), and small objects rougher."""
    every: int = 100
    """Steps between relocations."""
    start: float = 0.1
    """First relocation, as a share of all steps."""
    stop: float = 0.8
    """No relocation and no noise after this share of all steps."""
    growth: float = 0.15
    """New splats a relocation, as a share of those there are."""
    min_opacity: float = 0.005
    """Splats below are dead and move to where live ones are."""
    noise: float = 5e5
    """Strength of the exploration noise, times the rate of the means."""
    opacity_penalty: float = 0.01
    """Pull of visible splats towards transparency."""
    scale_penalty: float = 0.01
    """Pull of visible splats towards smallness, per metre."""


@dataclass(frozen=True)
class Multiview:
    """Which views L_pho and L_geo compare, and when."""

    start: float = 0.2
    """First comparison, as a share of all steps: depths have to mean something."""
    neighbours: int = 4
    """Most neighbours of a view; each step draws one of them."""
    max_angle_deg: float = 35.0
    """Largest angle between the viewing directions of neighbours."""
    min_baseline: float = 0.05
    """Least distance between the cameras of neighbours, metres."""
    max_baseline: float = 1.5
    """Largest distance between the cameras of neighbours, metres."""
    tolerance: float = 0.05
    """Depths within this share of each other show one surface: what lies further behind is hidden."""
    neighbour_depth: Literal["cached", "rendered"] = "cached"
    """cached: the neighbour's depth as it was when that view was drawn last. rendered: draw it again, and let L_geo
    move both, at the price of a second view a step."""

    def __post_init__(self) -> None:
        if self.neighbours < 1:
            raise ConfigError(
                f"--reconstruct.multiview.neighbours is {self.neighbours}: needs 1 or more. The weights "
                "--reconstruct.losses.photometric and geometric switch the comparison off."
            )
        if not 0 <= self.min_baseline < self.max_baseline:
            raise ConfigError(
                f"--reconstruct.multiview.min-baseline is {self.min_baseline} and max-baseline {self.max_baseline}: "
                "needs 0 or more, and less than the largest."
            )


@dataclass(frozen=True)
class SeedConfig:
    """Where the first splats come from."""

    random_points: int = 20_000
    """Points in the scene box, where a capture has neither depth nor points and its photographs match nowhere."""
    fewest_points: int = 2000
    """A capture without depth and with fewer points than this is seeded by stereo."""
    flatness: float = 0.15
    """Thickness over width of a seed splat with a known normal."""
    opacity: float = 0.8
    """Opacity of seeds on measured surface."""
    fill_share: float = 0.2
    """Share of stereo's seeds that lie where no view is sure, on depth interpolated inside each view."""
    fill_opacity: float = 0.1
    """Opacity of those."""
    stereo: StereoConfig = field(default_factory=StereoConfig)
    """Matching of the photographs."""


@dataclass(frozen=True)
class Monocular:
    """How depth of unknown scale and offset is aligned (captures of depth kind affine or inverse)."""

    settle: bool = True
    """Before the start, let the depth of each view give way, slowly across the image, until neighbours look alike."""
    refresh_every: int = 0
    """Epochs between fits of a view's scale and offset to the depth of the splats, as the paper has it. 0: only views
    that could not be aligned at the start are fitted, once. Splats that follow what follows them drift."""
    smoothing: float = 0.5
    """Share of the old scale and offset that a new fit leaves."""


@dataclass(frozen=True)
class ReconstructConfig:
    """How splats are optimised (paper §4)."""

    engine: EngineName = "auto"
    """What draws the splats, and where later stages compute. auto: a CUDA device if gsplat works there (a trial view
    decides), else the processor."""
    iterations: int = 2000
    """Optimisation steps."""
    views_a_step: int = 1
    """Views whose mean loss makes a step; a CUDA device draws them in one call."""
    sh_degree: int = 1
    """Degree of view-dependent colour, 0 to 3."""
    depth: Literal["plane", "expected"] = "plane"
    """Rendered depth that the losses see. plane: where rays meet the splats' planes. expected: of the splats' centres,
    Eq. (2) of the paper, which is biased towards the camera on slanted surfaces: docs/decisions/0005."""
    labels: Literal["votes", "learned"] = "votes"
    """votes: each splat takes the id whose pixels it colours most. learned: the paper's features, MLP and L_o."""
    holdout_every: int = 10
    """Every n-th view is kept out of the optimisation and measures PSNR; 0 trains on all."""
    checkpoint_every: int = 500
    """Steps between checkpoints, where there is a folder for them."""
    seed: int = 0
    """Random seed: the same seed gives the same bits on a CPU, for any number of threads."""
    seeding: SeedConfig = field(default_factory=SeedConfig)
    """First splats."""
    monocular: Monocular = field(default_factory=Monocular)
    """Aligning monocular depth."""
    losses: LossWeights = field(default_factory=LossWeights)
    """Weights of the losses."""
    rates: LearningRates = field(default_factory=LearningRates)
    """Step sizes."""
    multiview: Multiview = field(default_factory=Multiview)
    """Comparison of neighbouring views."""
    mcmc: Mcmc = field(default_factory=Mcmc)
    """Relocation, growth and noise."""

    def __post_init__(self) -> None:
        if self.views_a_step < 1:
            raise ConfigError(f"--reconstruct.views-a-step is {self.views_a_step}: needs 1 or more.")
