"""Where the files of a run are, inside its folder. No other module spells these names."""

from dataclasses import dataclass
from pathlib import Path

from goc.files.reading import is_file, is_folder

REPORT = "report.json"
OVERVIEW = "overview.png"
SCENE = "scene.json"
SCENE_MESH = "scene/mesh.ply"
SCENE_SPLATS = "scene/splats.ply"
SCENE_LABELS = "scene/labels.safetensors"
_OBJECTS = "objects"
_OBSERVED, _SOLID, _GLB = "observed.ply", "mesh.ply", "mesh.glb"
_SPLATS, _EVIDENCE = "splats.ply", "evidence.safetensors"


@dataclass(frozen=True)
class ObjectFiles:
    """Paths of one object's files, there or not."""

    folder: Path

    @property
    def observed(self) -> Path:
        """Measured surface, open."""
        return self.folder / _OBSERVED

    @property
    def solid(self) -> Path:
        """Closed surface."""
        return self.folder / _SOLID

    @property
    def glb(self) -> Path:
        """Closed surface for other tools, in the export's frame."""
        return self.folder / _GLB

    @property
    def splats(self) -> Path:
        """The object's own splats."""
        return self.folder / _SPLATS

    @property
    def evidence(self) -> Path:
        """Evidence grid."""
        return self.folder / _EVIDENCE


def object_files(folder: Path, id: int) -> ObjectFiles:
    """Paths of an object's files in the folder of a run."""
    return ObjectFiles(folder / _OBJECTS / str(id))


def object_ids(folder: Path) -> list[int]:
    """Ids that have a folder of their own, ascending."""
    if not is_folder(folder / _OBJECTS):
        return []
    names = [entry.name for entry in (folder / _OBJECTS).iterdir()]
    return sorted(int(name) for name in names if name.isascii() and name.isdigit() and not name.startswith("0"))


def run_files(folder: Path) -> list[Path]:
    """What goc has written into a folder, relative to it: these names and no others may be replaced or removed."""
    names = [folder / name for name in (REPORT, OVERVIEW, SCENE, SCENE_MESH, SCENE_SPLATS, SCENE_LABELS)]
    for id in object_ids(folder):
        own = object_files(folder, id)
        names += [own.observed, own.solid, own.glb, own.splats, own.evidence]
    return [path.relative_to(folder) for path in names if is_file(path)]
