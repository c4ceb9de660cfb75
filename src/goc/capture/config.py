"""Settings of the readers."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from goc.capture.convention import Convention
from goc.capture.source import StoredDepthKind
from goc.settings import Count, CountOrNone, Positive, Range, Settings

SidePx = Annotated[int, Range(least=16)]
"""Longer side of a view, pixels."""


@dataclass(frozen=True)
class CaptureConfig(Settings):
    """How a capture is read."""

    use_ids: bool = True
    """Use the instance ids that come with the capture; otherwise they count as absent."""
    use_depth: bool = True
    """Use the depth images that come with the capture; otherwise they count as absent."""
    use_normals: bool = True
    """Use the normal images that come with the capture; otherwise they count as absent."""
    depth_kind: StoredDepthKind | None = None
    """What a stored depth D means. metric: z. distance: along each pixel's ray. affine: z = k·D + b, inverse:
    1/z = k·D + b, with k > 0 and b unknown of each view, as monocular networks estimate depth and disparity. Default:
    as the capture says, else metric."""
    allow_missing: bool = False
    """Leave out views whose image is missing, and missing depth, ids or normals, with a warning instead of an error."""
    every: Count | None = None
    """Use every n-th view of a recording. Default: as many as leave at most 400; every view of a folder that somebody
    made for reconstruction."""
    max_side_px: SidePx = 640
    """Scale views down until the longer side has at most this many pixels."""
    units_per_metre: Positive | None = None
    """Scene units in one metre, where you know it. Default: 1 with metric depth, else guessed from the camera path."""
    cache_mb: CountOrNone = 512
    """Memory for decoded views, in MiB; views beyond it are decoded again when asked for."""
    checks: Literal["refuse", "warn", "off"] = "refuse"
    """What becomes of captures that contradict themselves (views that do not agree through depth, a unit that no room
    has, ids that are none). refuse: an error. warn: a warning, also in report.json. off: nothing is checked."""
    convention: Convention = field(default_factory=Convention)
    """How stored numbers are meant, where the capture says otherwise or nothing."""
