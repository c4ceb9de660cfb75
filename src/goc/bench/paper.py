"""The paper's own figures, as its tables print them: what ours stand beside.

Its rooms are five private ones, its ablation is on ScanNet: the shape of a table can be compared, not its level.
"""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class PaperRow:
    """A line of one of the paper's tables; what it does not state is absent."""

    label: str
    values: dict[str, float]
    time: str = ""


def _objects(accuracy: float, completion: float, chamfer: float, f_score: float) -> dict[str, float]:
    return {"accuracy": accuracy, "completion": completion, "chamfer": chamfer, "f_score_0.05": f_score}


def _scene(chamfer: float, f_score: float, consistency: float | None = None) -> dict[str, float]:
    values = {"scene.chamfer": chamfer, "scene.f_score_0.05": f_score}
    return values if consistency is None else values | {"scene.normal_consistency": consistency}


TABLES: dict[str, tuple[PaperRow, ...]] = {
    "table1": (
        PaperRow(
            label="ObjectSDF++ (MLP)",
            values=_objects(0.0232, 0.0511, 0.0371, 0.8741) | _scene(0.0240, 0.9164),
            time="21 h 26 min",
        ),
        PaperRow(
            label="RICO", values=_objects(0.0203, 0.0629, 0.0416, 0.8429) | _scene(0.0330, 0.8642), time="17 h 59 min"
        ),
        PaperRow(
            label="GOC without OSC",
            values=_objects(0.0045, 0.0543, 0.0294, 0.9124) | _scene(0.0211, 0.9570),
            time="1 h 07 min",
        ),
        PaperRow(label="GOC with ShapeFormer", values=_objects(0.0239, 0.0689, 0.0464, 0.7875), time="1 h 11 min"),
        PaperRow(label="GOC", values=_objects(0.0062, 0.0501, 0.0282, 0.9228), time="1 h 09 min"),
    ),
    "table2": (
        PaperRow(label="ObjectSDF++ (MLP)", values=_objects(0.0140, 0.0654, 0.0397, 0.8749)),
        PaperRow(label="RICO", values=_objects(0.0177, 0.0635, 0.0406, 0.8354)),
        PaperRow(label="GOC without OSC", values=_objects(0.0038, 0.0677, 0.0357, 0.8682)),
        PaperRow(label="GOC with ShapeFormer", values=_objects(0.0201, 0.0802, 0.0502, 0.7835)),
        PaperRow(label="GOC", values=_objects(0.0073, 0.0575, 0.0324, 0.9033)),
    ),
    "table4": (
        PaperRow(label="full", values=_scene(0.0556, 0.8243, 0.8591)),
        PaperRow(label="w/o L_dn", values=_scene(0.0534, 0.8430, 0.8201)),
        PaperRow(label="w/o L_d", values=_scene(0.1330, 0.3483, 0.7651)),
        PaperRow(label="w/o L_pho", values=_scene(0.0568, 0.8087, 0.8591)),
        PaperRow(label="w/o L_geo", values=_scene(0.0569, 0.8246, 0.8507)),
    ),
}
