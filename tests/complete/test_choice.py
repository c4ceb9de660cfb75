"""The choice among candidates, the file that it reads, and what is said where nothing is believable."""

from dataclasses import replace

import numpy as np
import pytest

from goc.complete import CompleteConfig, LiteConfig, build, close_objects, save_network, stage
from goc.complete.candidates import CONVEX, HULL, NETWORK, OUTLINES, candidates, hypotheses
from goc.complete.choice import OPEN, VERSION, Calibration, Line, choose, read_calibration
from goc.complete.features import FEATURES, features
from goc.errors import CompleteError, FileError
from goc.events import Warned
from goc.files import write_json
from goc.geometry.topology import watertight_flaw
from halfseen import as_object, half_seen
from seenshapes import box, seen_along

TINY = LiteConfig(cells=16, fine=8, middle=16, width=24, blocks=1, heads=2, hidden=16)


def constant(**errors):
    """A calibration that expects the same error of a candidate whatever its features; underscores are spaces."""
    lines = {
        name.replace("_", " "): Line(slopes=[float(np.log(error))] + [0.0] * (len(FEATURES) - 1), spread=0.0)
        for name, error in errors.items()
    }
    wide = [1e9] * len(FEATURES)
    return Calibration(schema=VERSION, features=list(FEATURES), low=[-x for x in wide], high=wide, lines=lines, cases=1)


@pytest.fixture(scope="module")
def crate():
    found, _ = seen_along(box((0.6, 0.4, 0.5)), ((0, -1), (1, -1), (2, -1)))
    return found, list(candidates(found, hypotheses(found), None))


def test_the_candidate_of_least_expected_error_is_chosen(crate):
    found, options = crate
    given = dict(evidence_hull=0.03, convex_hull=0.02, outlines=0.01, open=0.05)
    made = choose(found, options, constant(**given))
    assert made.name == OUTLINES and made.trusted
    assert made.expected_error == pytest.approx(0.01 * np.ptp(found.mesh.vertices, axis=0).max(), rel=1e-5)
    assert choose(found, options, constant(**(given | {"outlines": 0.04}))).name == CONVEX
    unknown = constant(evidence_hull=0.03, open=0.05)  # nothing is known of the others
    assert choose(found, options, unknown).name == HULL


def test_where_nothing_is_believable_the_tightest_closing_is_taken_and_not_trusted(crate):
    found, options = crate
    made = choose(found, options, constant(evidence_hull=0.03, convex_hull=0.02, outlines=0.01, open=0.005))
    sizes = {option.name: (option.composed.distance < 0).sum() for option in options}
    assert sizes[made.name] == min(sizes.values())
    assert not made.trusted and made.expected_error > made.open_error


def test_features_tell_how_far_candidates_are_apart(crate):
    found, options = crate
    rows = features(found, options)
    assert rows.shape == (len(options), len(FEATURES)) and np.isfinite(rows).all()
    names = [option.name for option in options]
    hull = FEATURES.index("apart from the hull")
    assert rows[names.index(HULL), hull] == pytest.approx(np.log(1e-4))
    assert rows[names.index(CONVEX), hull] > np.log(0.01)
    larger = replace(found, mesh=replace(found.mesh, vertices=2 * found.mesh.vertices))
    grown = [
        replace(
            option,
            composed=replace(option.composed, evidence=replace(option.composed.evidence, voxel=0.1)),
        )
        for option in options
    ]
    assert features(larger, grown) == pytest.approx(rows, abs=1e-5)  # whatever the unit


def test_a_calibration_beyond_what_was_met_is_not_extrapolated():
    steep = constant(open=0.01, evidence_hull=0.01)
    line = Line(slopes=[0.0, -5.0] + [0.0] * (len(FEATURES) - 2), spread=0.0)
    given = Calibration(
        schema=VERSION,
        features=steep.features,
        low=[-1.0] * len(FEATURES),
        high=[1.0] * len(FEATURES),
        lines=steep.lines | {NETWORK: line},
        cases=1,
    )
    row = np.zeros(len(FEATURES))
    row[1] = 40.0
    assert given.expected(NETWORK, row) == pytest.approx(np.exp(-5.0))
    assert given.expected("nobody", row) == np.inf
    row[1] = -40.0
    assert given.expected(NETWORK, row) == 1.0  # no error is larger than the object


def test_the_calibration_that_goc_ships_knows_all_candidates():
    found = read_calibration()
    assert {HULL, CONVEX, NETWORK, OUTLINES, OPEN} <= set(found.lines)
    assert found.cases >= 10


def test_a_calibration_of_another_goc_is_refused(tmp_path):
    given = constant(open=0.01, evidence_hull=0.01)
    path = tmp_path / "choice.json"
    write_json(path, Calibration(**{**_fields(given), "schema": VERSION + 1}))
    with pytest.raises(FileError, match=r"choice\.json: has schema"):
        read_calibration(path)
    for wrong in (
        {"features": given.features[:-1]},
        {"low": given.low[:-1]},
        {"lines": {OPEN: given.lines[OPEN]}},
        {"lines": given.lines | {NETWORK: Line(slopes=[1.0], spread=0.1)}},
    ):
        write_json(path, Calibration(**{**_fields(given), **wrong}))
        with pytest.raises(CompleteError, match=r"choice\.json: made for other features"):
            read_calibration(path)


def _fields(given):
    return {name: getattr(given, name) for name in ("schema", "features", "low", "high", "lines", "cases")}


@pytest.mark.parametrize(("bare", "trusted"), [(1.0, True), (1e-6, False)])
def test_objects_are_closed_by_the_best_candidate_and_doubt_is_told(tmp_path, monkeypatch, bare, trusted):
    """A ball's upper half. The network is untrained; the calibration trusts the convex hull."""
    save_network(tmp_path / "lite.safetensors", build(TINY))
    given = constant(open=bare, evidence_hull=0.03, convex_hull=0.01, network=0.5)
    monkeypatch.setattr(stage, "read_calibration", lambda: given)
    found, _, _ = half_seen()
    heard = []
    config = CompleteConfig(weights=tmp_path / "lite.safetensors", coarse_cells=16)
    (item,) = close_objects((as_object(found),), config, heard.append)
    assert watertight_flaw(item.solid.mesh) is None
    assert item.completed.trusted is trusted
    told = [event.message for event in heard if isinstance(event, Warned)]
    if trusted:
        assert item.completed.method == CONVEX and not told
        assert item.completed.expected_error == pytest.approx(0.01 * 0.8, rel=0.05)
    else:
        assert told == [
            "Object 3 (ball): no guess at what nobody saw of it is believable. It is closed as tightly as possible; "
            "views from its other sides would tell."
        ]
