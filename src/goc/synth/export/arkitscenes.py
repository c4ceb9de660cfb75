"""A scan of ARKitScenes."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from goc.files import write_bytes, write_depth, write_image, write_png
from goc.synth.export.cameras import as_text, intrinsics_of, sure_of
from goc.synth.export.exporter import Exporter
from goc.synth.export.room import RoomCapture

_START_S, _STEP_S = 6845.2, 0.1


def _write(room: RoomCapture, out: Path) -> None:
    """Write ID_frames/lowres_wide and its intrinsics, lowres_depth, confidence and the trajectory."""
    root, lines = out / f"{out.name}_frames", []
    for number, view in enumerate(room.views):
        time = _START_S + number * _STEP_S
        name = f"{out.name}_{time:.3f}"
        write_image(root / "lowres_wide" / f"{name}.png", view.image())
        numbers = np.array([[view.width, view.height, *intrinsics_of(view)]])
        late = f"{out.name}_{time + 0.001:.3f}.pincam"  # the data set's own times differ so
        write_bytes(root / "lowres_wide_intrinsics" / late, as_text(numbers))
        inverse = view.cam_from_world
        lines.append([time, *Rotation.from_matrix(inverse[:3, :3]).as_rotvec(), *inverse[:3, 3]])
        write_depth(root / "lowres_depth" / f"{name}.png", view.depth())
        write_png(root / "confidence" / f"{name}.png", sure_of(view.depth()))
    write_bytes(root / "lowres_wide.traj", as_text(np.array(lines)))


EXPORTER = Exporter(
    name="arkitscenes",
    writes="lowres_wide/, lowres_depth/ and the trajectory of ARKitScenes; no ids",
    write=_write,
    lacks=frozenset({"ids", "names"}),
)
