"""Checks of the photographs themselves."""

from collections.abc import Iterator

import numpy as np

from goc.capture.checks.finding import Finding, contradiction, doubt
from goc.capture.checks.sample import Sample
from goc.capture.source import count_of, shown

_FLAT = 2.0
"""Standard deviation of grey values below which a photograph shows nothing."""


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


def _thumbnail(image: np.ndarray) -> np.ndarray:
    height, width = image.shape
    return image[:: max(1, height // 32), :: max(1, width // 32)]
