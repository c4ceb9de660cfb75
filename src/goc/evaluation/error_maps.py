"""Error maps of the worst objects: prediction and truth, coloured by the distance to each other."""

import base64
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64, UInt8
from PIL import Image

from goc.evaluation.prediction import read_prediction
from goc.evaluation.result import Evaluation
from goc.evaluation.truth import Truth, read_truth
from goc.geometry.raycast import TriangleScene
from goc.report.portraits import Paint, turntable
from goc.scene import Mesh

RAMP: tuple[tuple[float, tuple[int, int, int]], ...] = (
    (0.0, (233, 236, 232)),
    (0.005, (163, 209, 204)),
    (0.01, (86, 157, 190)),
    (0.0125, (243, 205, 118)),
    (0.025, (235, 137, 66)),
    (0.05, (170, 40, 62)),
    (0.06, (92, 14, 60)),
)
"""Metres and sRGB: cool as long as a point counts as right at 1 cm, warm up to 5 cm, dark beyond."""
_SIZE = 300
_SIDES = 3
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, kw_only=True)
class ErrorMaps:
    """Error maps of one object from several sides, as data: URIs of PNG files."""

    id: int
    prediction: list[str]
    """From each side, coloured by distance to the truth; empty where it is missing."""
    truth: list[str]
    """From the same sides, coloured by distance to the prediction."""


def worst_objects(evaluation: Evaluation, count: int) -> list[int]:
    """Ids, worst first: by F at the widest threshold, then by chamfer distance."""
    threshold = max(name for name in evaluation.mean if name.startswith("f_score_"))

    def quality(id: int) -> tuple[float, float]:
        figures = evaluation.objects[id].figures
        return figures[threshold] or 0.0, -(figures["chamfer"] or 0.0)

    return sorted(evaluation.objects, key=quality)[:count]


def worst_error_maps(evaluation: Evaluation, run: Path, truth: Path, count: int) -> list[ErrorMaps]:
    """Render error maps of the `count` worst objects of an evaluation of `run` against `truth`."""
    known, made = read_truth(truth), read_prediction(run, evaluation.meshes)
    found = []
    for id in worst_objects(evaluation, count):
        own = evaluation.objects[id].predicted
        found.append(_error_maps(id, known, None if own is None else made.objects[own].mesh))
    return found


def colours_of_distance(distances: Float64[np.ndarray, "n"]) -> Float64[np.ndarray, "n 3"]:
    """The ramp's colours, 0 … 255; beyond its end the last."""
    places = [at for at, _ in RAMP]
    channels = np.array([colour for _, colour in RAMP], np.float64)
    return np.stack([np.interp(distances, places, channels[:, axis]) for axis in range(3)], axis=1)


def _error_maps(id: int, truth: Truth, predicted: Mesh | None) -> ErrorMaps:
    true = truth.mesh(id)
    if predicted is None:
        grey = Mesh(vertices=true.vertices, faces=true.faces)
        return ErrorMaps(id=id, prediction=[], truth=_uris(turntable(grey, _UP, _SIZE, true, count=_SIDES)))
    return ErrorMaps(
        id=id,
        prediction=_uris(turntable(predicted, _UP, _SIZE, true, _painter(true), _SIDES)),
        truth=_uris(turntable(true, _UP, _SIZE, true, _painter(predicted), _SIDES)),
    )


def _painter(mesh: Mesh) -> Paint:
    """Colours points by their distance to a mesh."""
    scene, end = TriangleScene(mesh.vertices, mesh.faces), RAMP[-1][0]
    return lambda points: colours_of_distance(np.minimum(scene.nearest(points, end)[0], end))


def _uris(pictures: list[UInt8[np.ndarray, "h w 3"]]) -> list[str]:
    return [_uri(picture) for picture in pictures]


def _uri(pixels: UInt8[np.ndarray, "h w 3"]) -> str:
    encoded = io.BytesIO()
    Image.fromarray(pixels).save(encoded, format="PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(encoded.getvalue()).decode("ascii")
