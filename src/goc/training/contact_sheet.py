"""A contact sheet of completions: one row a case, with what was seen, each method's completion, and the truth."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from goc.complete import Measured
from goc.files import write_png
from goc.report.canvas import FAINT, Canvas
from goc.scene import Mesh
from goc.training.baselines import CHOICE, HULL, NETWORK, POISSON, Completion
from goc.training.masking import MaskedObject
from goc.training.thumbnails import shaded

_SIZE, _HEAD, _LINE = 160, 22, 16
_SEEN, _MADE, _TRUE = (0.65, 0.8, 0.65), (0.75, 0.8, 0.9), (0.85, 0.85, 0.85)


class ContactSheet:
    """Rows of pictures of one size, with a title for each column and a caption for each row."""

    def __init__(self) -> None:
        """Begin an empty sheet."""
        self._columns: list[str] = []
        self._lines: list[tuple[str, list[UInt8[np.ndarray, "h w 3"]]]] = []

    def add(self, caption: str, seen: Measured, made: Mapping[str, Completion], masked: MaskedObject) -> None:
        """Draw one case: seen, hull, Poisson, the network where there is one, truth."""
        methods = [name for name in (HULL, POISSON, NETWORK, CHOICE) if name in made]
        solid = masked.placed.shape.mesh
        placed = solid.vertices @ masked.placed.matrix.T + masked.placed.shift
        mirrored = np.linalg.det(masked.placed.matrix) < 0
        faces = np.ascontiguousarray(solid.faces[:, ::-1]) if mirrored else solid.faces
        truth = Mesh(vertices=masked.cube.model_from_world(placed), faces=faces)
        pictures = [shaded(seen.mesh, _SIZE, _SEEN), *(shaded(made[name].mesh, _SIZE, _MADE) for name in methods)]
        self._columns = ["seen", *methods, "truth"]
        self._lines.append((caption, [*pictures, shaded(truth, _SIZE, _TRUE)]))

    def write(self, path: Path) -> None:
        """Put the lines below each other into a PNG."""
        step = _SIZE + _LINE
        page = Canvas(max(1, len(self._columns)) * _SIZE, _HEAD + step * max(1, len(self._lines)))
        for column, name in enumerate(self._columns):
            page.text(name, column * _SIZE + 6, 4, 13, _SIZE - 8)
        for line, (caption, pictures) in enumerate(self._lines):
            top = _HEAD + line * step
            page.text(caption, 6, top, 11, len(pictures) * _SIZE, FAINT)
            for column, picture in enumerate(pictures):
                page.picture(picture, column * _SIZE, top + _LINE, _SIZE, _SIZE)
        write_png(path, page.pixels())
