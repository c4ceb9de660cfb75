"""Nouns: frozen, shaped, frame-named. Metres, radians, OpenCV cameras, float32. Imports nothing else of goc."""

from goc.scene.cache import ViewCache
from goc.scene.camera import Camera
from goc.scene.capture import (
    ROOM,
    UNLABELLED,
    Alignment,
    Capture,
    DepthKind,
    Frame,
    FrameSource,
    PointCloud,
    StoredFrames,
)
from goc.scene.contact import Contact, HalfSpace
from goc.scene.gaussians import Gaussians
from goc.scene.mesh import Evidence, EvidenceGrid, Mesh
from goc.scene.object import Completed, FlaggedMesh, SceneObject
from goc.scene.priors import CapturePriors, CoarseDepth
from goc.scene.reconstruction import Reconstruction
from goc.scene.rendering import Rendering
from goc.scene.scene import Scene
from goc.scene.world import World

__all__ = [
    "ROOM",
    "UNLABELLED",
    "Alignment",
    "Camera",
    "Capture",
    "CapturePriors",
    "CoarseDepth",
    "Completed",
    "Contact",
    "DepthKind",
    "FlaggedMesh",
    "Evidence",
    "EvidenceGrid",
    "Frame",
    "FrameSource",
    "Gaussians",
    "HalfSpace",
    "Mesh",
    "PointCloud",
    "Reconstruction",
    "Rendering",
    "Scene",
    "SceneObject",
    "World",
    "StoredFrames",
    "ViewCache",
]
