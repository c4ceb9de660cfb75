"""A training shape placed in a world: rotated, stretched, mirrored, standing on the ground."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64
from scipy.spatial.transform import Rotation

from goc.geometry.raycast import RayHits
from goc.training.watertight_shape import WatertightShape

Random = np.random.Generator


@dataclass(frozen=True, kw_only=True, eq=False)
class PlacedShape:
    """A shape in the world: world point = matrix · shape point + shift."""

    shape: WatertightShape
    matrix: Float64[np.ndarray, "3 3"]
    """Rotation, stretch and mirroring: any invertible matrix."""
    shift: Float64[np.ndarray, "3"]

    def box(self) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]:
        """Least and greatest corner of the shape's bounding box, world axes."""
        vertices = self.shape.mesh.vertices @ self.matrix.T + self.shift
        return vertices.min(0), vertices.max(0)

    def distances(self, points: Float[np.ndarray, "p 3"]) -> Float32[np.ndarray, "p"]:
        """Signed distance in the world: exact in sign, first order near the surface where the shape is stretched."""
        back = np.linalg.inv(self.matrix)
        local = (points - self.shift) @ back.T
        found = self.shape.distances(local)
        sizes = np.linalg.norm(self.matrix, axis=0)
        if np.ptp(sizes) < 1e-6:
            return (found * sizes[0]).astype(np.float32)
        near = np.abs(found) < 3 * self.shape.voxel
        slope = np.full(len(points), 1.0 / sizes.mean())
        slope[near] = np.linalg.norm(self._gradient(local[near]) @ back, axis=-1)
        return (found / np.maximum(slope, 0.2 / sizes.max())).astype(np.float32)

    def closest_hit(
        self, origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]
    ) -> tuple[RayHits, Float64[np.ndarray, "n 3"]]:
        """Nearest hits, t in lengths of the world's directions, and unit normals outwards, world."""
        back = np.linalg.inv(self.matrix)
        hits = self.shape.scene.closest_hit((origins - self.shift) @ back.T, directions @ back.T)
        corners = self.shape.mesh.vertices[self.shape.mesh.faces[np.maximum(hits.triangle, 0)]].astype(np.float64)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ back
        return hits, normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)

    def surface(self, count: int, seed: int) -> tuple[Float64[np.ndarray, "p 3"], Float64[np.ndarray, "p 3"]]:
        """Samples of the surface in the world, and unit normals outwards."""
        samples = self.shape.surface(count, seed)
        normals = samples.normals @ np.linalg.inv(self.matrix)
        normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
        return samples.points @ self.matrix.T + self.shift, normals

    def _gradient(self, local: Float64[np.ndarray, "p 3"]) -> Float64[np.ndarray, "p 3"]:
        step = 0.5 * self.shape.voxel
        moved = [self.shape.distances(local + way * step * axis) for axis in np.eye(3) for way in (1, -1)]
        slopes = np.stack([moved[2 * axis] - moved[2 * axis + 1] for axis in range(3)], -1).astype(np.float64)
        return slopes / np.maximum(np.linalg.norm(slopes, axis=-1, keepdims=True), 1e-9)


def random_placement(solid: WatertightShape, random: Random) -> tuple[PlacedShape, float]:
    """Place a shape at random: any yaw, stretched by up to a quarter, mirrored or not; and the yaw, radians.

    Most stand upright. One in ten is rotated freely, as in captures without gravity, or as things that lie about.
    """
    yaw = random.uniform(0, 2 * np.pi)
    turn = Rotation.from_euler("z", yaw)
    if random.random() < 0.1:
        turn = Rotation.from_quat(random.normal(size=4))
    elif random.random() < 0.3:
        turn = Rotation.from_rotvec(np.deg2rad(3) * random.normal(size=3)) * turn
    stretch = random.uniform(0.8, 1.25, 3) if random.random() < 0.6 else np.ones(3)
    stretch[1] *= random.choice([-1.0, 1.0])
    matrix = turn.as_matrix() * stretch
    lowest = (solid.mesh.vertices @ matrix.T)[:, 2].min()
    return PlacedShape(shape=solid, matrix=matrix, shift=np.array([0.0, 0.0, -lowest])), float(yaw)
