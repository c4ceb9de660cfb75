"""What was measured of an object, with its mirror image where nothing was: the hypothesis that it is symmetric."""

import numpy as np

from goc.complete.compose import Measured
from goc.complete.mirrors import MirrorPlane, mirrored_evidence
from goc.scene import Evidence, EvidenceGrid, Mesh


def mirrored(found: Measured, plane: MirrorPlane) -> Measured:
    """What would have been measured, had what lies behind the plane been seen like its image.

    Returns:
        Unknown voxels are as `mirrored_evidence` has them; measured and seen-empty ones stay. The mesh gains the
        mirrored faces that lie where nothing was known.
    """
    return Measured(
        mesh=_mirrored_mesh(found.mesh, found.evidence, plane), evidence=mirrored_evidence(found.evidence, plane)
    )


def _mirrored_mesh(mesh: Mesh, evidence: EvidenceGrid, plane: MirrorPlane) -> Mesh:
    image = plane.image(mesh.vertices.astype(np.float64))
    at = np.rint((image - evidence.origin) / evidence.voxel).astype(np.int64)
    top = np.array(evidence.state.shape) - 1
    within = ((at >= 0) & (at <= top)).all(axis=1)
    new = within & (evidence.state[tuple(np.clip(at, 0, top).T)] == Evidence.UNKNOWN)
    faces = mesh.faces[new[mesh.faces].all(axis=1)][:, ::-1]  # a mirror turns what is clockwise round
    number = np.cumsum(new) - 1 + len(mesh.vertices)
    colours = None if mesh.colours is None else np.concatenate([mesh.colours, mesh.colours[new]])
    return Mesh(
        vertices=np.concatenate([mesh.vertices, image[new].astype(np.float32)]),
        faces=np.concatenate([mesh.faces, number[faces].astype(np.int32)]),
        colours=colours,
    )
