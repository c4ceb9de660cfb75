"""One thing of a scene, whole."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float64

from goc.scene.gaussians import Gaussians
from goc.scene.mesh import EvidenceGrid, Mesh


@dataclass(frozen=True, kw_only=True, eq=False)
class FlaggedMesh:
    """A mesh that keeps what is measured apart from what is not."""

    mesh: Mesh
    observed: Bool[np.ndarray, "v"]
    """Per vertex: some camera measured this surface."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneObject:
    """One object: all that is known of it; what is absent is None. Geometry is in the capture's world and units."""

    id: int
    name: str
    """As the capture or the segmentation calls it."""
    world_from_object: Float64[np.ndarray, "4 4"] = field(default_factory=lambda: np.eye(4))
    """Pose of the object's own frame, rigid. Identity until something moves the object."""
    splats: Gaussians | None = None
    observed: FlaggedMesh | None = None
    """Measured surface, open where nothing was seen."""
    solid: FlaggedMesh | None = None
    """Closed surface."""
    evidence: EvidenceGrid | None = None
    """What the cameras say of the box round it."""

    @property
    def surface(self) -> FlaggedMesh | None:
        """The closed surface where there is one, else the measured one."""
        return self.observed if self.solid is None else self.solid
