"""Settings of the readers."""

from dataclasses import dataclass

from goc.errors import ConfigError
from goc.scene import DepthKind


@dataclass(frozen=True)
class CaptureConfig:
    """How a capture is read."""

    use_ids: bool = True
    """Use the instance ids that come with the capture; otherwise they count as absent."""
    use_depth: bool = True
    """Use the depth images that come with the capture; otherwise they count as absent."""
    use_normals: bool = True
    """Use the normal images that come with the capture; otherwise they count as absent."""
    depth_kind: DepthKind | None = None
    """What a stored depth D means. metric: z. affine: z = k·D + b, inverse: 1/z = k·D + b, with k > 0 and b unknown of
    each view, as monocular networks estimate depth and disparity. Default: as the capture says, else metric."""
    allow_missing: bool = False
    """Leave out views whose image is missing, and missing depth, ids or normals, with a warning instead of an error."""
    max_side_px: int = 640
    """Scale views down until the longer side has at most this many pixels."""
    units_per_metre: float | None = None
    """Scene units in one metre, where you know it. Default: 1 with metric depth, else guessed from the camera path."""
    cache_mb: int = 512
    """Memory for decoded views, in MiB; views beyond it are decoded again when asked for."""

    def __post_init__(self) -> None:
        if self.max_side_px < 16:
            raise ConfigError(f"--capture.max-side-px is {self.max_side_px}: needs at least 16.")
        if self.units_per_metre is not None and not 0 < self.units_per_metre < float("inf"):
            raise ConfigError(f"--capture.units-per-metre is {self.units_per_metre}: needs a positive number.")
        if self.cache_mb < 0:
            raise ConfigError(f"--capture.cache-mb is {self.cache_mb}: needs 0 or more.")
