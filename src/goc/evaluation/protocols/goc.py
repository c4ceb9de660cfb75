"""The protocol `goc`: area-uniform samples of complete objects; missing objects count, closed ones are examined."""

from goc.evaluation.labels import AMBIGUOUS_WITHIN, RECALL_WITHIN, label_accuracy, label_recall
from goc.evaluation.metrics import SAMPLES, sample_surface
from goc.evaluation.protocols.protocol import MatchedRun, ProtocolResult, surface_figures
from goc.evaluation.rooms import has_surface, score_surfaces
from goc.evaluation.truth import SEEN_WITHIN
from goc.evaluation.volumes import (
    IOU_CELLS,
    NO_PENETRATION,
    OVERLAP_CELLS,
    Penetration,
    RoomWalls,
    SolidMesh,
    intersection_over_union,
    penetration,
    wall_depth,
    wall_volume,
)
from goc.events import Listener, Progress
from goc.geometry.raycast import TriangleScene
from goc.geometry.topology import is_closed
from goc.scene import ROOM

_THRESHOLDS = (0.05, 0.01)
_EXTRA_BEYOND = 1 << 20
"""Predicted objects that match nothing go by ids above this among those that match."""


def score_goc(matched: MatchedRun, notify: Listener) -> ProtocolResult:
    """Score a run by our own protocol; see docs/guide/eval.md for every figure.

    Raises:
        FileError: a true mesh is missing or malformed.
    """
    scorer = _GocScorer(matched)
    objects = {}
    for done, id in enumerate(matched.truth.objects):
        objects[id] = scorer.object_figures(id)
        notify(Progress(stage="score objects", done=done + 1, total=len(matched.truth.objects)))
    return ProtocolResult(
        objects=objects,
        scene=None if scorer.scores.scene is None else surface_figures(scorer.scores.scene, with_split=False),
        settings={
            "object_samples": SAMPLES,
            "scene_samples": len(matched.truth.seen),
            "thresholds": list(_THRESHOLDS),
            "seen_within": SEEN_WITHIN,
            "label_recall_within": RECALL_WITHIN,
            "label_ambiguous_within": AMBIGUOUS_WITHIN,
            "iou_points": IOU_CELLS**3,
            "penetration_points": OVERLAP_CELLS**3,
        },
    )


class _GocScorer:
    """A matched run with what several of its figures need, computed once."""

    def __init__(self, matched: MatchedRun) -> None:
        self.matched = matched
        self.solids = {id: matched.prediction.objects[own].solid for id, own in matched.matches.items()}
        self.samples = {id: sample_surface(solid.mesh, SAMPLES, matched.seed) for id, solid in self.solids.items()}
        self.truth = {id: SolidMesh(matched.truth.mesh(id)) for id in matched.truth.objects}
        self.walls = RoomWalls(matched.truth.mesh(ROOM))
        meshes = {id: solid.mesh for id, solid in self.solids.items()}
        self.scores = score_surfaces(matched.truth, meshes, matched.prediction.scene, matched.seed)
        self.true_scenes = {id: solid.scene for id, solid in self.truth.items()} | {ROOM: self.walls.scene}
        self.predicted_scenes = {id: solid.scene for id, solid in self.solids.items()} | _extra_scenes(matched)

    def object_figures(self, id: int) -> dict[str, float]:
        """Every figure of one object."""
        figures = surface_figures(self.scores.objects[id]) | self._label_figures(id)
        if id not in self.solids:
            return figures | {"iou": 0.0, "watertight": 0.0}
        return figures | self._solid_figures(id) | self._contact_figures(id)

    def _label_figures(self, id: int) -> dict[str, float]:
        true = self.matched.truth.objects[id]
        recall = label_recall(true.samples.points[true.seen], id, self.true_scenes, self.predicted_scenes)
        if id not in self.samples:
            return {"label_accuracy": 0.0, "label_recall": recall}
        return {
            "label_accuracy": label_accuracy(self.samples[id].points, id, self.true_scenes),
            "label_recall": recall,
        }

    def _solid_figures(self, id: int) -> dict[str, float]:
        solid, true = self.solids[id], self.truth[id]
        nan = float("nan")
        volume = solid.volume if solid.flaw is None else nan
        expected = true.volume if true.has_inside else nan
        bottom = float(solid.box[0][2] - true.box[0][2])
        figures = {
            "watertight": float(solid.flaw is None),
            "self_intersections": float(solid.self_intersections),
            "volume": volume,
            "volume_truth": expected,
            "volume_error": abs(volume - expected),
            "volume_relative_error": abs(volume - expected) / expected if expected > 0 else nan,
            "volume_ratio": volume / expected if expected > 0 else nan,
            "bottom": bottom,
            "bottom_error": abs(bottom),
            "iou": nan,
        }
        if true.has_inside:
            closed = solid.has_inside
            figures["iou"] = intersection_over_union(solid, true, self.matched.seed) if closed else 0.0
        return figures

    def _contact_figures(self, id: int) -> dict[str, float]:
        figures = {}
        solid = self.solids[id]
        if solid.has_inside:
            found = [self._between(id, other) for other in self.solids if other != id]
            figures["penetration_depth"] = max((item.depth for item in found), default=0.0)
            figures["penetration_volume"] = sum(item.volume for item in found)
        if is_closed(self.walls.mesh):
            figures["room_depth"] = wall_depth(self.samples[id], self.walls)
            if solid.has_inside:
                figures["room_volume"] = wall_volume(solid, self.walls, self.matched.seed)
        return figures

    def _between(self, id: int, other: int) -> Penetration:
        first, second = sorted((id, other))  # either of the two hears the same
        a, b = self.solids[first], self.solids[second]
        if not b.has_inside or not a.has_inside:
            return NO_PENETRATION
        return penetration(a, self.samples[first], b, self.samples[second], self.matched.seed)


def _extra_scenes(matched: MatchedRun) -> dict[int, TriangleScene]:
    meshes = {own: matched.prediction.objects[own].mesh for own in matched.extra}
    return {
        _EXTRA_BEYOND + own: TriangleScene(mesh.vertices, mesh.faces)
        for own, mesh in meshes.items()
        if has_surface(mesh)
    }
