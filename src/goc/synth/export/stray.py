"""Stray Scanner's recordings, the video's frames already taken out."""

from pathlib import Path

from scipy.spatial.transform import Rotation

from goc.files import write_bytes, write_depth, write_png
from goc.synth.export.cameras import Y_UP_FROM_Z_UP, intrinsics_of, jpeg_of, sure_of
from goc.synth.export.exporter import Exporter
from goc.synth.export.room import RoomCapture


def _write(room: RoomCapture, out: Path) -> None:
    """Write rgb/ (frames of what would be rgb.mp4), camera_matrix.csv, odometry.csv, depth/ and confidence/."""
    lines = ["timestamp, frame, x, y, z, qx, qy, qz, qw"]
    for number, view in enumerate(room.views):
        pose, name = Y_UP_FROM_Z_UP @ view.world_from_cam, f"{number:06}"
        numbers = (*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat())
        lines.append(", ".join([f"{4000 + number / 60:.6f}", name, *(f"{value:.12g}" for value in numbers)]))
        write_bytes(out / "rgb" / f"{name}.jpg", jpeg_of(view))
        write_depth(out / "depth" / f"{name}.png", view.depth())
        write_png(out / "confidence" / f"{name}.png", sure_of(view.depth()))
    fx, fy, cx, cy = intrinsics_of(room.views[0])
    write_bytes(out / "camera_matrix.csv", f"{fx!r}, 0, {cx!r}\n0, {fy!r}, {cy!r}\n0, 0, 1\n".encode())
    write_bytes(out / "odometry.csv", ("\n".join(lines) + "\n").encode())


EXPORTER = Exporter(
    name="stray",
    writes="odometry.csv, depth/ and frames of Stray Scanner, y up; no ids",
    write=_write,
    lacks=frozenset({"ids", "names"}),
)
