"""Writes a capture as a Record3D recording: a ZIP archive whose depth is LZFSE."""

import io
import zipfile
from pathlib import Path

import msgspec
import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from goc.errors import ExportError
from goc.files import write_atomic
from goc.scene import Capture
from goc.synth.export.cameras import arkit_pose_of, intrinsics_of

_SURE = 2


def export(capture: Capture, folder: Path) -> None:
    """Write FOLDER/scan.r3d; its world begins at the first camera, as Record3D's does.

    Raises:
        ExportError: the library that compresses depth is not installed.
    """
    with write_atomic(folder / "scan.r3d") as file, zipfile.ZipFile(file, "w") as packed:
        packed.writestr("metadata", msgspec.json.encode(_metadata(capture)))
        for number, frame in enumerate(capture):
            encoded = io.BytesIO()
            Image.fromarray(frame.image.numpy()).save(encoded, "JPEG", quality=95, subsampling=0)
            packed.writestr(f"rgbd/{number}.jpg", encoded.getvalue())
            if frame.depth is not None:
                metres = frame.depth.numpy().astype("<f4")
                sure = np.where(np.isnan(metres), 0, _SURE).astype(np.uint8)
                packed.writestr(f"rgbd/{number}.depth", _compressed(metres.tobytes()))
                packed.writestr(f"rgbd/{number}.conf", _compressed(sure.tobytes()))


def _metadata(capture: Capture) -> dict[str, object]:
    first, camera = arkit_pose_of(capture.cameras[0]), capture.cameras[0]
    fx, fy, cx, cy = intrinsics_of(camera)
    return {
        "w": camera.width,
        "h": camera.height,
        "dw": camera.width,
        "dh": camera.height,
        "fps": 30,
        "K": [fx, 0, 0, 0, fy, 0, cx, cy, 1],
        "perFrameIntrinsicCoeffs": [intrinsics_of(each) for each in capture.cameras],
        "poses": [_numbers(np.linalg.inv(first) @ arkit_pose_of(each)) for each in capture.cameras],
        "initPose": _numbers(first),
    }


def _numbers(pose: np.ndarray) -> list[float]:
    return [*Rotation.from_matrix(pose[:3, :3]).as_quat().tolist(), *pose[:3, 3].tolist()]


def _compressed(data: bytes) -> bytes:
    try:
        import lzfse  # pyright: ignore[reportMissingImports]  # an extra
    except ImportError as error:
        raise ExportError("lzfse is not installed, which Record3D's depth needs: pip install 'goc[phones]'.") from error
    return lzfse.compress(data)
