"""One thing of a scene, whole."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float64

from goc.scene.contact import Contact, HalfSpace
from goc.scene.gaussians import Gaussians
from goc.scene.mesh import EvidenceGrid, Mesh


@dataclass(frozen=True, kw_only=True, eq=False)
class FlaggedMesh:
    """A mesh that keeps what is measured apart from what is not."""

    mesh: Mesh
    observed: Bool[np.ndarray, "v"]
    """Per vertex: some camera measured this surface."""


@dataclass(frozen=True, kw_only=True)
class Completed:
    """How an object was closed, and how far that can be trusted."""

    method: str
    """What filled in the unknown."""
    expected_error: float | None = None
    """Chamfer distance to the true surface that is to be expected, scene units; None where nothing foretells it."""
    trusted: bool = True
    """Whether the closed surface is expected to be no further from the truth than the open one."""


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
    completed: Completed | None = None
    """How `solid` came about, where this run made it."""
    evidence: EvidenceGrid | None = None
    """What the cameras say of the box round it."""
    contact: Contact | None = None
    """What bears it; None where nothing was found to, as under a lamp, or where nobody has looked yet."""
    walls: tuple[HalfSpace, ...] = ()
    """Planes of the room that it is in front of."""

    @property
    def surface(self) -> FlaggedMesh | None:
        """The closed surface where there is one, else the measured one."""
        return self.observed if self.solid is None else self.solid
