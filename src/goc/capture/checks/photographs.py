"""Checks of the photographs themselves."""

from collections.abc import Iterator

import numpy as np

from goc.capture.checks.epipolar import photo_agreement, photo_pairs
from goc.capture.checks.finding import Finding, contradiction, doubt
from goc.capture.checks.readings import convention_words, other_conventions
from goc.capture.checks.sample import Sample
from goc.capture.convention import reread
from goc.capture.scale import guess_units_per_metre
from goc.capture.source import count_of, shown

_FLAT = 2.0
"""Standard deviation of grey values below which a photograph shows nothing."""
_FEW = 4
"""Views below which photographs are not compared."""
_TYPICAL_M = 2.0
_CLEARLY, _AGREES, _DISAGREES = 0.05, 0.07, 0.03
"""Scores of `photo_agreement`: 0.08 to 0.19 measured with right poses, 0.07 and less with others."""


def photograph_findings(sample: Sample) -> Iterator[Finding]:
    """Photographs that show nothing, or are one."""
    names = [sample.capture.view_names[row] for row in sample.indices]
    grey = [frame.image.double().mean(2).numpy() for frame in sample.frames]
    flat = [name for name, image in zip(names, grey, strict=True) if image.std() < _FLAT]
    if len(flat) == len(names):
        yield contradiction(
            "images-empty", f"all {len(names)} photographs that were looked at are of one colour. Check the images."
        )
        return
    if flat:
        yield doubt(
            "images-empty",
            f"{count_of(flat, len(names))} photographs that were looked at are of one colour (first: {shown(flat[0])})",
        )
    small = [_thumbnail(image) for image in grey]
    same = [name for row, name in enumerate(names) if any(np.array_equal(small[row], one) for one in small[:row])]
    if same:
        yield doubt(
            "images-repeat",
            f"{count_of(same, len(names))} photographs that were looked at repeat another (first: {shown(same[0])})",
        )


def pose_findings(sample: Sample) -> Iterator[Finding]:
    """Whether photographs without depth agree with their poses."""
    capture, poses = sample.capture, sample.poses
    if capture.has_metric_depth or len(capture) < _FEW:
        return
    pairs = photo_pairs(capture, poses, max(4, len(sample.frames) // 2))
    if len(pairs) < 3:
        return
    distance = _TYPICAL_M * guess_units_per_metre(list(poses))
    stated = photo_agreement(pairs, poses, distance)
    tried = [
        (photo_agreement(pairs, reread(poses, sample.source, reading), distance), reading)
        for reading in other_conventions(sample.source)
    ]
    best, reading = max(tried, key=lambda one: one[0])
    if best > stated + _CLEARLY and best > _AGREES:
        looks, options = convention_words(sample.source, reading)
        yield contradiction(
            "photo-agreement",
            f"poses look {looks}: read so, photographs match along their lines of sight (score {best:.2f}), as the "
            f"capture says they hardly do ({stated:.2f}). Pass {options}.",
        )
    elif stated < _DISAGREES:
        yield doubt(
            "photo-agreement",
            f"photographs do not match along the lines of sight that poses give (score {stated:.2f}; right captures "
            "reach 0.08 and more): poses, intrinsics, or their pairing with the images may be wrong",
        )


def _thumbnail(image: np.ndarray) -> np.ndarray:
    height, width = image.shape
    return image[:: max(1, height // 32), :: max(1, width // 32)]
