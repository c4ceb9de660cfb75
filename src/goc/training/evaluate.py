"""`goc osc eval`: scores completions of validation meshes by a network, and by baselines that need no training."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float32

from goc.complete import Measured, Network, cell_centres
from goc.evaluation.metrics import SurfaceSamples, sample_surface, surface_scores
from goc.events import Listener, Progress, ignore
from goc.geometry.topology import is_watertight
from goc.scene import Evidence, EvidenceGrid
from goc.settings import Amount, Count, OpenShare, Range, Seed, Settings
from goc.training.baselines import Completion, completions, measured_object
from goc.training.contact_sheet import ContactSheet
from goc.training.cuts import AS_SEEN
from goc.training.library import open_library
from goc.training.masking import MaskConfig, MaskedObject, mask
from goc.training.samples import true_distance
from goc.training.validation import occupancy_score
from goc.training.watertight_shape import WatertightShape

GROUPS = {"complete": (7, 99), "1-3 views": (1, 3), "4-6 views": (4, 6), "room": (7, 99)}
"""Kinds of input, with the least and the greatest number of views of each."""
SAMPLES = 30_000
_NEAR, _WIDE = 0.01, 0.02
"""Thresholds of F, in longest sides of the true box."""
_PICTURED = 4
_TRIES = 8
_AS_SEEN = {"front": 0.0, "cuts": AS_SEEN, "jitter": 0.0}
"""What training varies and scoring does not."""
_SHARP_PX = 144
"""Side of the depth images that see all of a shape, twice those of training: thin walls need more than 72 pixels."""


@dataclass(frozen=True, kw_only=True)
class EvalConfig(Settings):
    """How completions are scored."""

    masks: Count = 4
    """Masks of each shape, taken in turn from: complete with exact depth, 1-3 views, 4-6 views, a scanned room."""
    shapes: Count | None = None
    """Number of shapes to score, spread evenly over the split; default: all."""
    cells: Annotated[int, Range(least=8, most=512)] = 96
    """Cells along each side of the cube, at whose centres IoU is counted."""
    threshold: OpenShare = 0.5
    """Occupancy at the surface of a network. The paper's T_b = 0.3 inflates it (docs/decisions)."""
    noise: Amount = 1.0
    """Strength of depth noise where views are few, or a room's: as in training."""
    seed: Seed = 0
    """Seed of the masks."""


@dataclass(frozen=True, kw_only=True)
class CompletionScore:
    """Scores of one completion. Lengths are in units of the longest side of the true box."""

    iou: float
    """Volume in both over volume in either, counted at the centres of the cells of the cube."""
    accuracy: float
    completion: float
    chamfer_mean: float
    """(accuracy + completion) / 2, as in the paper's tables of rooms."""
    chamfer_sum: float
    """accuracy + completion, as in 3DShape2VecSet."""
    f_1: float
    """F at 1 % of the longest side: the 0.02 of papers whose shapes fill [-1, 1]."""
    f_2: float
    """F at 2 % of the longest side."""
    normal_consistency: float
    watertight: float
    """1 if the mesh is, 0 if not."""
    unknown_accuracy: float
    """Of the cells of the true box that the evidence leaves undecided, the share that is called rightly."""
    seconds: float
    """From evidence to mesh."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ObjectTruth:
    """Ground truth of one masked object, in the frame of its cube ([-1, 1]³)."""

    centres: Float32[np.ndarray, "p 3"]
    """Centres of the cells of the cube."""
    inside: Bool[np.ndarray, "p"]
    undecided: Bool[np.ndarray, "p"]
    """Cells in the true box that evidence leaves undecided."""
    surface: SurfaceSamples
    longest: float
    """Side of the true box."""


@dataclass(frozen=True, kw_only=True)
class MethodScore:
    """The scores of one method on one masked object."""

    shape: str
    group: str
    views: int
    method: str
    score: CompletionScore


@dataclass(frozen=True, kw_only=True)
class MeanScores:
    """Mean scores of one method on one group of masks."""

    group: str
    method: str
    count: int
    empty: int
    """Masks for which the method made no surface: left out of accuracy, completion and CD, counted as 0 in the rest."""
    scores: dict[str, float]


@dataclass(frozen=True, kw_only=True)
class CompletionReport:
    """The result of `goc osc eval`."""

    config: EvalConfig
    shapes: int
    floor: float
    """Mean distance between two samplings of the same true surface: no CD mean says less than this."""
    rows: tuple[MeanScores, ...]
    outcomes: tuple[MethodScore, ...]


def evaluate(
    data: Path,
    network: Network | None,
    config: EvalConfig,
    notify: Listener = ignore,
    pictures: Path | None = None,
) -> CompletionReport:
    """Score the shapes of split val in a prepared folder.

    Args:
        data: what `goc osc prepare` wrote.
        network: None: score only the baselines that need no training.
        config: number and kinds of masks, and the grid that IoU is counted on.
        notify: hears progress.
        pictures: PNG that shows some cases as seen, completed and true; None: it is not written.

    Raises:
        TrainError: no shapes of split val.
    """
    library = open_library(data, "val")
    count = min(config.shapes or len(library), len(library))
    chosen = [int(index) for index in np.linspace(0, len(library) - 1, count).round()]
    pictured = set(chosen[:: max(1, count // _PICTURED)][:_PICTURED])
    contact_sheet, floors = ContactSheet(), []
    found: list[MethodScore] = []
    for done, index in enumerate(chosen):
        name = library.shapes[index].name
        for group, masked, seen in cases(library[index], config, index):
            target = object_truth(masked, config.cells)
            floors.append(surface_scores(true_surface_samples(masked, 2), target.surface).chamfer / target.longest)
            made = dict(completions(seen, masked, network, config.threshold))
            found += [
                MethodScore(shape=name, group=group, views=masked.views, method=method, score=score(completed, target))
                for method, completed in made.items()
            ]
            if pictures is not None and index in pictured:
                contact_sheet.add(f"{name}, {group}", seen, made, masked)
        notify(Progress(stage="evaluate", done=done + 1, total=count))
    if pictures is not None:
        contact_sheet.write(pictures)
    floor = float(np.mean(floors)) if floors else float("nan")
    return CompletionReport(config=config, shapes=count, floor=floor, rows=means(found), outcomes=tuple(found))


def cases(
    solid: WatertightShape, config: EvalConfig, index: int, groups: Sequence[str] = tuple(GROUPS)
) -> Iterator[tuple[str, MaskedObject, Measured]]:
    """Masks of one shape, each with the group that it belongs to and what was measured; the same for the same index."""
    for number in range(config.masks):
        group = groups[number % len(groups)]
        fewest, most = GROUPS[group]
        random = np.random.default_rng([config.seed, 7, index, number])
        for _ in range(_TRIES):
            masked = mask(solid, _masking(group, config), random)
            seen = measured_object(masked) if masked is not None and fewest <= masked.views <= most else None
            if masked is not None and seen is not None:
                yield group, masked, seen
                break


def _masking(group: str, config: EvalConfig) -> MaskConfig:
    if group == "complete":
        return MaskConfig(strategy="none", size_px=_SHARP_PX, noise=0.0, **_AS_SEEN)
    return MaskConfig(
        arc=0.0 if group == "room" else 1.0,
        room=1.0 if group == "room" else 0.0,
        noise=config.noise,
        **_AS_SEEN,
    )


def object_truth(masked: MaskedObject, cells: int) -> ObjectTruth:
    """The truth of a masked object, with IoU counted on `cells`³ cells of its cube."""
    centres = cell_centres(cells).reshape(-1, 3)
    truth = true_surface_samples(masked, 1)
    low, high = truth.points.min(axis=0), truth.points.max(axis=0)
    within = ((centres >= low) & (centres <= high)).all(axis=1)
    return ObjectTruth(
        centres=centres,
        inside=true_distance(masked, centres) < 0,
        undecided=within & ~_decided(masked.partial.evidence, centres),
        surface=truth,
        longest=float((high - low).max()),
    )


def true_surface_samples(masked: MaskedObject, seed: int) -> SurfaceSamples:
    """The true surface, in the frame of the cube."""
    points, normals = masked.placed.surface(SAMPLES, seed)
    return SurfaceSamples(points=masked.cube.model_from_world(points).astype(np.float64), normals=normals)


def score(completed: Completion, target: ObjectTruth) -> CompletionScore:
    """Score the completion of one method against the truth."""
    longest = target.longest
    occupancy = occupancy_score(completed.inside(target.centres), target.inside, target.undecided)
    samples = sample_surface(completed.mesh, SAMPLES) if len(completed.mesh.faces) else None
    surface = surface_scores(samples, target.surface, thresholds=(_NEAR * longest, _WIDE * longest))
    f_1, f_2 = surface.f_score.values()
    return CompletionScore(
        iou=occupancy.iou,
        accuracy=surface.accuracy / longest,
        completion=surface.completion / longest,
        chamfer_mean=surface.chamfer / longest,
        chamfer_sum=2 * surface.chamfer / longest,
        f_1=f_1,
        f_2=f_2,
        normal_consistency=surface.normal_consistency,
        watertight=float(is_watertight(completed.mesh)),
        unknown_accuracy=occupancy.unknown_accuracy,
        seconds=completed.seconds,
    )


def _decided(evidence: EvidenceGrid, points: np.ndarray) -> np.ndarray:
    """Which points lie in a voxel where surface was seen or a ray passed."""
    at = np.rint((points - evidence.origin) / evidence.voxel).astype(np.int64)
    top = np.array(evidence.state.shape) - 1
    known = evidence.state[tuple(np.clip(at, 0, top).T)] != Evidence.UNKNOWN
    return known & ((at >= 0) & (at <= top)).all(axis=1)


def means(found: Sequence[MethodScore]) -> tuple[MeanScores, ...]:
    """Mean scores by group and method; each mask counts once."""
    rows = []
    partial = [group for group in GROUPS if group != "complete"]
    for name, groups in (*((group, [group]) for group in GROUPS), ("all partial", partial)):
        for method in dict.fromkeys(one.method for one in found):
            own = [asdict(one.score) for one in found if one.method == method and one.group in groups]
            if not own:
                continue
            made = [one for one in own if np.isfinite(one["chamfer_mean"])]
            lengths = ("accuracy", "completion", "chamfer_mean", "chamfer_sum")
            scores = {
                key: float(np.mean([one[key] for one in (made if key in lengths else own)] or [np.inf]))
                for key in own[0]
            }
            rows.append(
                MeanScores(group=name, method=method, count=len(own), empty=len(own) - len(made), scores=scores)
            )
    return tuple(rows)


_COLUMNS = ("IoU", "Acc", "Comp", "CD mean", "CD sum", "F@1%", "F@2%", "NC", "watertight", "unknown accuracy", "s")


def table(report: CompletionReport) -> str:
    """The rows as a Markdown table, and below it what its figures mean."""
    lines = [
        "| input | method | masks | " + " | ".join(_COLUMNS) + " |",
        "|---" * (3 + len(_COLUMNS)) + "|",
        *(_line(row) for row in report.rows),
    ]
    return "\n".join(lines) + "\n\n" + foot(report)


def _line(row: MeanScores) -> str:
    count = f"{row.count}" if not row.empty else f"{row.count} ({row.empty} empty)"
    score = row.scores
    cells = [
        f"{score['iou']:.3f}",
        *(f"{score[key]:.4f}" for key in ("accuracy", "completion", "chamfer_mean", "chamfer_sum")),
        *(f"{score[key]:.3f}" for key in ("f_1", "f_2", "normal_consistency")),
        f"{score['watertight']:.1%}",
        f"{score['unknown_accuracy']:.3f}",
        f"{score['seconds']:.2f}",
    ]
    return f"| {row.group} | {row.method} | {count} | " + " | ".join(cells) + " |"


def foot(report: CompletionReport) -> str:
    """What the figures mean, and under which settings they were taken."""
    config = report.config
    lines = (
        f"{report.shapes} shapes of split val, seed {config.seed}. Means over masks. Lengths in longest sides of the "
        "true box (times 2 where shapes fill [-1, 1]).",
        "IoU: of volumes, uniform over the cube of side 1.25 round what was seen, at the centres of "
        f"{config.cells}³ cells.",
        "CD mean = (Acc + Comp) / 2, as in the paper's rooms; CD sum = Acc + Comp, as in 3DShape2VecSet. Unsquared, "
        f"{SAMPLES:,} area-uniform samples a side: two samplings of one surface have a CD mean of {report.floor:.4f}.",
        "F@1% of the longest side is the F@0.02 of shapes that fill [-1, 1]. NC: mean |cos|. watertight: share of "
        "meshes with two faces an edge, consistent winding, no empty face, positive volume.",
        "unknown accuracy: over cells of the true box that no ray decided. s: "
        "from evidence to mesh, whatever else ran.",
        f"complete: 20 views all round of {_SHARP_PX}² pixels, exact depth. Others: 72² pixels, noise "
        f"{config.noise:g}, surroundings that hide. Meshes on the evidence's own voxels, 86 to 104 along its longest "
        "side.",
        "All but `network alone` keep measured surface and leave seen-empty space empty. nothing: the measured surface "
        "as it is (its IoU: of the band behind it).",
        "outlines, mirrored: see docs/decisions/0039; where one does not apply, the convex hull or the "
        "network stands in for it. choice: the candidate of least expected error.",
        f"network: surface at occupancy {config.threshold:g}. perfect guess: the truth wherever evidence is silent, "
        "the bound for any completion of this evidence.",
    )
    return "\n".join(f"- {line}" for line in lines) + "\n"
