"""Whether a run is in the unit and the place of its truth at all."""

import numpy as np
from jaxtyping import Float64

from goc.evaluation.prediction import Prediction
from goc.evaluation.truth import Truth

_UNITS = {1000.0: "millimetres", 100.0: "centimetres", 39.37: "inches", 3.281: "feet", 0.001: "kilometres"}
_LIKE = 1.3
"""Factor by which the sizes of run and truth may differ from a unit's."""
_UNLIKE, _UNLIKE_OBJECTS = 3.0, 10.0
"""Factor from which on the sizes of whole scenes, and of things, cannot be of one unit."""
_REMEDY = "Scale it to metres."

Box = tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]


def scale_doubt(made: Prediction, truth: Truth) -> str | None:
    """One line on what makes scores meaningless: another unit, or another frame; None where there is nothing.

    Scenes are compared with all that was seen; without a scene, the middle one of the objects' sizes with the true one.
    """
    whole = made.scene is not None and len(made.scene.vertices) > 0 and len(truth.seen) > 0
    run = [item.mesh.vertices for item in made.objects.values() if len(item.mesh.vertices)]
    true = [item.samples.points for item in truth.objects.values() if len(item.samples)]
    if made.scene is not None and whole:
        run, true = [*run, made.scene.vertices], [*true, truth.seen.points]
    if not run or not true:
        return None
    boxes = [_box(parts) for parts in (run, true)]
    size, right = ([_size(box)] if whole else [_size(_box([one])) for one in parts]
                   for box, parts in zip(boxes, (run, true), strict=True))  # fmt: skip
    times = float(np.median(size) / max(np.median(right), 1e-12))
    limit = _UNLIKE if whole else _UNLIKE_OBJECTS
    unit = next((name for factor, name in _UNITS.items() if 1 / _LIKE < times / factor < _LIKE), None)
    if 1 / limit < times < limit and (unit is None or not whole):
        apart = (boxes[0][0] > boxes[1][1]).any() or (boxes[1][0] > boxes[0][1]).any()
        return "The run lies beside the truth, not in it: it is in another frame." if apart else None
    said = f"The run is {times:,.3g} times as large as the truth"
    return f"{said}{', and its scores mean nothing' if unit is None else f': it seems to be in {unit}'}. {_REMEDY}"


def _box(parts: list[np.ndarray]) -> Box:
    return (
        np.min([part.min(axis=0) for part in parts if len(part)], axis=0).astype(np.float64),
        np.max([part.max(axis=0) for part in parts if len(part)], axis=0).astype(np.float64),
    )


def _size(box: Box) -> float:
    return float(np.linalg.norm(box[1] - box[0]))
