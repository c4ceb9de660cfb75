"""A model in the stage: any network's answers become closed objects; wrong weights are refused."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch

from goc.complete import (
    CompleteConfig,
    LiteConfig,
    bounding_cube,
    build,
    close_objects,
    compose,
    model_fill,
    save_network,
    with_margin,
)
from goc.complete.stage import narrowed
from goc.errors import CompleteError
from goc.geometry.surfaces import vertex_normals
from goc.scene import Evidence
from halfseen import as_object, half_seen, positions
from oracles.watertight import signed_volume, trouble

TINY = LiteConfig(cells=16, fine=8, middle=8, width=16, blocks=1, heads=2, hidden=8)


@dataclass
class Knowing:
    """A model that knows the ball: exact distances in its own frame, steep log-odds."""

    centre: np.ndarray
    radius: float
    cube: object

    def complete(self, partial):
        self.partial = partial
        return self

    def logits(self, points):
        centre = torch.from_numpy(self.cube.model_from_world(self.centre[None])[0])
        radius = 2 * self.radius / self.cube.side
        return 50.0 * (radius - torch.linalg.norm(points - centre, dim=-1))


def test_a_model_that_knows_the_answer_completes_the_ball():
    found, radius, centre = half_seen()
    model = Knowing(centre, radius, bounding_cube(np.concatenate([found.mesh.vertices])))
    fill = model_fill(model, found, vertex_normals(found.mesh), 0.5, coarse_cells=16)
    done = compose(found, fill)
    assert trouble(done.mesh.vertices, done.mesh.faces) == ""
    # The cube goes round what was seen: the upper half, so the ball's bottom lies beyond its floor.
    floor = model.cube.centre[2] - model.cube.side / 2
    off = np.linalg.norm(done.mesh.vertices - centre, axis=1) - radius
    above = done.mesh.vertices[:, 2] > floor + 2 * found.evidence.voxel
    assert np.abs(off[above]).max() < 0.4 * found.evidence.voxel
    assert np.abs(model.partial.points).max() <= 1.0
    assert (model.partial.normals**2).sum(axis=1) == pytest.approx(1.0, abs=1e-4)


def test_weights_on_disk_complete_objects(tmp_path):
    """Untrained: it may say anything, the object is closed and its seen surface in place all the same."""
    save_network(tmp_path / "lite.safetensors", build(TINY))
    found, radius, centre = half_seen()
    config = CompleteConfig(method="lite", weights=tmp_path / "lite.safetensors", coarse_cells=16)
    (item,) = close_objects((as_object(found),), config)
    done = item.solid
    assert trouble(done.mesh.vertices, done.mesh.faces) == ""
    off = np.linalg.norm(done.mesh.vertices - centre, axis=1) - radius
    assert np.abs(off[done.observed]).max() < 0.1 * found.evidence.voxel
    grid = with_margin(found.evidence)
    passed = positions(grid)[grid.state == Evidence.EMPTY]
    assert signed_volume(done.mesh.vertices, done.mesh.faces) < grid.voxel**3 * (grid.state.size - len(passed))
    with pytest.raises(CompleteError, match=r"lite\.safetensors: these are not weights of osc"):
        close_objects((as_object(found),), replace(config, method="osc"))


def test_the_band_that_a_network_is_shown_is_as_wide_as_in_training():
    found, _, _ = half_seen()
    evidence = found.evidence
    thin = narrowed(evidence, evidence.voxel)
    kept = thin.state == Evidence.SURFACE
    assert (np.abs(evidence.sdf[kept]) <= evidence.voxel).all()
    gone = (evidence.state == Evidence.SURFACE) & ~kept
    assert (thin.state[gone & (evidence.sdf > 0)] == Evidence.EMPTY).all()
    assert (thin.state[gone & (evidence.sdf < 0)] == Evidence.UNKNOWN).all()
    assert (thin.sdf[~kept] == 0).all()
    same = narrowed(evidence, 1.0)
    assert np.array_equal(same.state, evidence.state) and np.array_equal(same.sdf, evidence.sdf)
