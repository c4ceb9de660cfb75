"""`goc osc calibrate`: how far each candidate can be trusted, learnt where the truth is known, and tested elsewhere."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from goc.capture import load_capture
from goc.complete import Measured, closed_surface, compose_field, model_fill, with_margin
from goc.complete.bounds import Bounds, bounded, bounds_of, cut
from goc.complete.candidates import candidates, coarsened, hypotheses
from goc.complete.choice import Calibration
from goc.complete.compose import Composition
from goc.complete.contacts import with_contacts
from goc.complete.features import features, longest_side
from goc.complete.partial import Completer
from goc.complete.stage import seen_part, small_first
from goc.evaluation.metrics import SurfaceSamples, sample_surface, surface_scores
from goc.evaluation.truth import read_truth
from goc.events import Listener, Progress, ignore
from goc.extract import ExtractConfig, WorldConfig, extract_objects, find_world, fuse_scene, views_noise
from goc.geometry.surfaces import vertex_normals
from goc.scene import EvidenceGrid, FlaggedMesh, Mesh
from goc.settings import Count, OpenShare, Seed, Settings
from goc.training.evaluate import EvalConfig, cases, true_surface_samples
from goc.training.fit_choice import Case, fit_calibration
from goc.training.library import open_library

_SAMPLES = 10_000
_COARSE = 64
_GROUPS = ("1-3 views", "room", "4-6 views")


@dataclass(frozen=True, kw_only=True)
class CalibrateConfig(Settings):
    """Where the candidates are tried."""

    shapes: Count = 50
    """Shapes of split train that the calibration is fitted to; half as many of split val test it."""
    masks: Count = 2
    """Masks of each shape: few views, a scanned room, some views, in turn."""
    threshold: OpenShare = 0.5
    """Occupancy at the surface of the network."""
    seed: Seed = 0
    """Seed of the masks."""


@dataclass(frozen=True, kw_only=True)
class CalibrationReport:
    """A calibration, and how it does on shapes and rooms that it was not fitted to."""

    calibration: Calibration
    tested: tuple[Case, ...]


def calibrate(
    data: Path,
    rooms: Sequence[Path],
    held_rooms: Sequence[Path],
    network: Completer,
    config: CalibrateConfig,
    notify: Listener = ignore,
) -> CalibrationReport:
    """Try all candidates on objects of which the truth is known, fit their errors, and test the fit.

    Args:
        data: what `goc osc prepare` wrote; split train is fitted to, split val tests.
        rooms: captures with gt/ to fit to as well, such as those of `goc synth room --split train`.
        held_rooms: captures with gt/ that test.
        network: what the candidates ask.
        config: how many shapes and masks.
        notify: hears progress.

    Raises:
        TrainError: no shapes of a split.
        CaptureError: a room cannot be read.
    """
    asker = _Asker(network=network, threshold=config.threshold)
    held = max(1, config.shapes // 2)
    plan = [("train", config.shapes, rooms), ("val", held, held_rooms)]
    total = config.shapes + held + len(rooms) + len(held_rooms)
    found: list[list[Case]] = []
    done = 0
    for split, count, captures in plan:
        own: list[Case] = []
        sources = [_shape_cases(data, split, count, asker, config), *(_room_cases(room, asker) for room in captures)]
        for source in sources:
            for part in source:
                own += part
                done += 1
                notify(Progress(stage="calibrate", done=done, total=total))
        found.append(own)
    return CalibrationReport(calibration=fit_calibration(found[0]), tested=tuple(found[1]))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Asker:
    network: Completer
    threshold: float

    def fill(self, found: Measured, at: EvidenceGrid) -> np.ndarray:
        return model_fill(self.network, found, vertex_normals(found.mesh), self.threshold, _COARSE, at)


def _shape_cases(data: Path, split: str, count: int, asker: _Asker, config: CalibrateConfig) -> Iterator[list[Case]]:
    library = open_library(data, "train" if split == "train" else "val")
    masks = EvalConfig(masks=config.masks, seed=config.seed)
    for index in np.linspace(0, len(library) - 1, min(count, len(library))).round().astype(int).tolist():
        part = []
        for group, masked, seen in cases(library[index], masks, index, _GROUPS):
            truth = true_surface_samples(masked, 1)
            part.append(_case((library.shapes[index].name, group), seen, truth, asker))
        yield part


def _room_cases(room: Path, asker: _Asker) -> Iterator[list[Case]]:
    """Objects fused from exact depth, within their contacts and small ones first, as `close_objects` takes them."""
    capture, config = load_capture(room), ExtractConfig()
    noise = views_noise(capture)
    mesh = fuse_scene(capture, config, noise=noise)
    world = find_world(mesh, capture, WorldConfig())
    objects = with_contacts(extract_objects(capture, config, noise=noise), mesh, world)
    bounds, truth = bounds_of(objects), read_truth(room)
    part: list[Case] = []
    filled: list[Composition] = []
    for item in (objects[place] for place in small_first(objects)):
        limits = bounds[item.id]
        found = seen_part(item, limits, filled)
        if found is None:
            continue
        evidence = with_margin(bounded(found.evidence, limits))
        composed = compose_field(evidence, asker.fill(found, found.evidence), found.mesh.vertices)
        filled.append(cut(composed, limits, filled))
        if item.id in truth.objects:
            name, samples = f"{room.name}/{item.id}", truth.objects[item.id].samples
            part.append(_case((name, "scanned"), found, samples, asker, limits))
    yield part


def _case(
    named: tuple[str, str], found: Measured, truth: SurfaceSamples, asker: _Asker, limits: Bounds | None = None
) -> Case:
    """All candidates of an object, and how far each is from the truth; `named` are the shape and its group."""
    coarse, longest = coarsened(found), longest_side(found)
    options = list(candidates(found, hypotheses(coarse), asker.fill, coarse))
    ended = [option.composed if limits is None else cut(option.composed, limits, ()) for option in options]
    made = [_with_guesses(found.mesh, closed_surface(composed, found.mesh)) for composed in ended]
    return Case(
        shape=named[0],
        group=named[1],
        names=tuple(option.name for option in options),
        rows=features(coarse, options),
        errors=np.array([_error(mesh, truth, longest) for mesh in made]),
        open_error=_error(found.mesh, truth, longest),
    )


def _with_guesses(seen: Mesh, closed: FlaggedMesh) -> Mesh:
    """The measured surface as fine as it is, with what a coarse completion adds to it."""
    guessed = closed.mesh.faces[~closed.observed[closed.mesh.faces].all(axis=1)]
    return Mesh(
        vertices=np.concatenate([seen.vertices, closed.mesh.vertices]),
        faces=np.concatenate([seen.faces, guessed + np.int32(len(seen.vertices))]),
    )


def _error(mesh: Mesh, truth: SurfaceSamples, longest: float) -> float:
    """Chamfer distance in longest sides; 1 where there is no surface."""
    if not len(mesh.faces):
        return 1.0
    return surface_scores(sample_surface(mesh, _SAMPLES), _some(truth), thresholds=()).chamfer / longest


def _some(truth: SurfaceSamples) -> SurfaceSamples:
    step = max(1, len(truth) // _SAMPLES)
    return replace(truth, points=truth.points[::step], normals=truth.normals[::step])
