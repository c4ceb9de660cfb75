"""A scene of ScanNet++: photographs of a DSLR, COLMAP's model of them, and the room's meshes as the laser scan."""

from pathlib import Path

import numpy as np

from goc.errors import CaptureError
from goc.files import is_file, read_mesh, write_json, write_mesh, write_png
from goc.scene import ROOM, Mesh
from goc.synth.export import colmap
from goc.synth.export.cameras import names_of
from goc.synth.export.exporter import Exporter
from goc.synth.export.room import RoomCapture
from goc.synth.sensor.source import link

_ALL_VALID = 255


def _write(room: RoomCapture, out: Path) -> None:
    """Write dslr/resized_images, its masks and colmap/, and scans/ with a segment for each object."""
    part = out / "dslr"
    colmap.write_model(room, part / "colmap")
    for view in room.views:
        name = view.image_path.name
        link(view.image_path, part / "resized_images" / name)
        mask = np.full((view.height, view.width), _ALL_VALID, np.uint8)
        write_png((part / "resized_anon_masks" / name).with_suffix(".png"), mask)
    _write_scan(room, out / "scans")


def _write_scan(room: RoomCapture, out: Path) -> None:
    """One mesh of the whole room; segment n is object n, the last one the walls."""
    truth = room.folder / "gt"
    names = names_of(room)
    files = {key: truth / "objects" / f"{key}.ply" for key in names} | {ROOM: truth / "room.ply"}
    lacking = [path.name for path in files.values() if not is_file(path)]
    if lacking:
        raise CaptureError(f"{truth}: {len(lacking)} meshes are missing (first: {lacking[0]}). Give a room with gt/.")
    vertices, faces, segments, start = [], [], [], 0
    for key, path in files.items():
        mesh = read_mesh(path)
        vertices.append(mesh.vertices)
        faces.append(mesh.faces + start)
        segments += [key] * len(mesh.vertices)
        start += len(mesh.vertices)
    whole = Mesh(vertices=np.concatenate(vertices), faces=np.concatenate(faces).astype(np.int32))
    write_mesh(out / "mesh_aligned_0.05.ply", whole)
    write_json(out / "segments.json", {"segIndices": segments})
    wall = max(names, default=0) + 1
    groups = [{"id": key, "objectId": key, "label": name, "segments": [key]} for key, name in names.items()]
    groups.append({"id": wall, "objectId": wall, "label": "wall", "segments": [ROOM]})
    write_json(out / "segments_anno.json", {"segGroups": groups})


EXPORTER = Exporter(
    name="scannetpp", writes="dslr/ and scans/ of ScanNet++: depth and ids are on the scan", write=_write
)
