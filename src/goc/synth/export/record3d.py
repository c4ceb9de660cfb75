"""A Record3D recording: a ZIP archive whose depth is LZFSE."""

import zipfile
from pathlib import Path

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from goc.errors import ExportError
from goc.files import write_atomic
from goc.synth.export.cameras import arkit_pose_of, intrinsics_of, jpeg_of, sure_of
from goc.synth.export.exporter import Exporter
from goc.synth.export.room import RoomCapture


def _write(room: RoomCapture, out: Path) -> None:
    """Write scan.r3d; its world begins at the first camera, as Record3D's does."""
    with write_atomic(out / "scan.r3d") as file, zipfile.ZipFile(file, "w") as packed:
        packed.writestr("metadata", msgspec.json.encode(_metadata(room)))
        for number, view in enumerate(room.views):
            depth = view.depth()
            packed.writestr(f"rgbd/{number}.jpg", jpeg_of(view))
            packed.writestr(f"rgbd/{number}.depth", _compressed(depth.astype("<f4").tobytes()))
            packed.writestr(f"rgbd/{number}.conf", _compressed(sure_of(depth).tobytes()))


def _metadata(room: RoomCapture) -> dict[str, object]:
    view = room.views[0]
    first = arkit_pose_of(view)
    fx, fy, cx, cy = intrinsics_of(view)
    return {
        "w": view.width,
        "h": view.height,
        "dw": view.width,
        "dh": view.height,
        "fps": 30,
        "K": [fx, 0, 0, 0, fy, 0, cx, cy, 1],
        "perFrameIntrinsicCoeffs": [intrinsics_of(each) for each in room.views],
        "poses": [_numbers(np.linalg.inv(first) @ arkit_pose_of(each)) for each in room.views],
        "initPose": _numbers(first),
    }


def _numbers(pose: np.ndarray) -> list[float]:
    return [*Rotation.from_matrix(pose[:3, :3]).as_quat().tolist(), *pose[:3, 3].tolist()]


def _compressed(data: bytes) -> bytes:
    try:
        import lzfse
    except ImportError as error:
        raise ExportError("lzfse is not installed, which Record3D's depth needs: pip install 'goc[phones]'.") from error
    return lzfse.compress(data)


EXPORTER = Exporter(
    name="record3d",
    writes="one .r3d recording; no ids (needs the extra goc[phones])",
    write=_write,
    lacks=frozenset({"ids", "names"}),
)
