"""Small captures with known truth, written to disk in each format: a textured box room with two boxes in it.

Everything is closed form, so a reader's output can be compared with what the same camera really sees.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image

from cameras import looking_at
from goc.capture.source import Lens
from goc.files import write_depth, write_ids, write_normals, write_png, write_points
from goc.scene import PointCloud

ROOM_BOX = np.array([[0.0, 0.0, 0.0], [4.0, 3.0, 2.5]])
OBJECTS = {1: np.array([[1.0, 0.8, 0.0], [1.9, 1.6, 0.7]]), 2: np.array([[2.3, 1.3, 0.0], [2.9, 2.2, 1.1]])}
LABELS = {"0": "room", "1": "crate", "2": "cupboard"}
LENS = Lens(64, 48, (50.0, 51.0), (31.0, 24.5))
BENT = replace(LENS, radial=(0.12, -0.05, 0.0, 0.0), tangential=(0.004, -0.003))


@dataclass(frozen=True)
class Shot:
    """What a camera sees: uint8 (h w 3), metres (h w), ids (h w)."""

    image: np.ndarray
    depth: np.ndarray
    ids: np.ndarray


def poses(count: int = 6) -> list[np.ndarray]:
    """World from camera (OpenCV axes) on an arc round the boxes, z up."""
    made = []
    for angle in np.linspace(0.3, 2 * np.pi - 0.5, count):
        position = np.array([2.0 + 1.7 * np.cos(angle), 1.5 + 1.2 * np.sin(angle), 1.5 + 0.2 * np.sin(3 * angle)])
        made.append(looking_at(position, (2.0, 1.4, 0.5)))
    return made


def unbend(lens: Lens, bent: np.ndarray) -> np.ndarray:
    """Undistorted directions of distorted ones: fixed-point iteration of the OpenCV model, written out on its own."""
    (k1, k2, k3, k4), (p1, p2) = lens.radial, lens.tangential
    x, y = bent[..., 0], bent[..., 1]
    for _ in range(100):
        r2 = x**2 + y**2
        radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3 + k4 * r2**4
        shift_x = 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
        shift_y = p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
        x, y = (bent[..., 0] - shift_x) / radial, (bent[..., 1] - shift_y) / radial
    return np.stack([x, y], -1)


def see(pose: np.ndarray, lens: Lens = LENS) -> Shot:
    """Cast the ray of every pixel centre."""
    u, v = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    bent = np.stack([(u - lens.centre_px[0]) / lens.focal_px[0], (v - lens.centre_px[1]) / lens.focal_px[1]], -1)
    rays = np.concatenate([unbend(lens, bent), np.ones((*u.shape, 1))], -1) @ pose[:3, :3].T
    depth = _slabs(pose[:3, 3], rays, ROOM_BOX)[1]
    ids = np.zeros(u.shape, np.int16)
    for number, box in OBJECTS.items():
        near, far = _slabs(pose[:3, 3], rays, box)
        hit = (near < far) & (near > 0) & (near < depth)
        depth = np.where(hit, near, depth)
        ids[hit] = number
    points = pose[:3, 3] + rays * depth[..., None]
    waves = np.sin(points @ np.array([[1.9, -0.6, 0.4], [0.7, 2.1, -1.3], [-1.1, 0.9, 2.3]]) + ids[..., None])
    return Shot(np.rint(127.5 + 110 * waves).astype(np.uint8), depth, ids)


def _slabs(origin: np.ndarray, rays: np.ndarray, box: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ray parameters (z depth) where each ray enters and leaves a box."""
    with np.errstate(divide="ignore"):
        a, b = (box[0] - origin) / rays, (box[1] - origin) / rays
    return np.minimum(a, b).max(-1), np.maximum(a, b).min(-1)


def keep(document: dict) -> None:
    """Change nothing."""


def write_nerfstudio(folder: Path, views: int = 6, lens: Lens = LENS, change: Callable[[dict], None] = keep) -> Path:
    """A nerfstudio capture with depth, ids, labels and seed points; `change` edits the JSON before it is written."""
    frames = []
    for number, pose in enumerate(poses(views)):
        shot = see(pose, lens)
        name = f"{number:04d}.png"
        write_png(folder / "images" / name, shot.image)
        write_depth(folder / "depth" / name, shot.depth)
        write_ids(folder / "instance" / name, shot.ids)
        opengl = pose.copy()
        opengl[:, 1:3] *= -1
        files = {"file_path": f"images/{name}", "depth_file_path": f"depth/{name}"}
        frames.append(files | {"instance_file_path": f"instance/{name}", "transform_matrix": opengl.tolist()})
    keys = ("fl_x", "fl_y", "cx", "cy", "k1", "k2", "k3", "k4", "p1", "p2")
    numbers = zip(keys, (*lens.focal_px, *lens.centre_px, *lens.radial, *lens.tangential), strict=True)
    document = {"camera_model": "OPENCV", "w": lens.width, "h": lens.height, **dict(numbers)}
    document |= {"depth_unit_scale_factor": 0.001, "ply_file_path": "points.ply", "frames": frames}
    write_points(folder / "points.ply", corners())
    (folder / "labels.json").write_text(json.dumps(LABELS))
    change(document)
    (folder / "transforms.json").write_text(json.dumps(document))
    return folder


def with_normals(folder: Path, lens: Lens = LENS, turn: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Path:
    """Add to a nerfstudio capture the normals of what each camera sees, times `turn`."""
    document = json.loads((folder / "transforms.json").read_text())
    for number, frame in enumerate(document["frames"]):
        opengl = np.array(frame["transform_matrix"])
        pose = opengl * [1, -1, -1, 1]
        shot = see(pose, lens)
        u, v = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
        bent = np.stack([(u - lens.centre_px[0]) / lens.focal_px[0], (v - lens.centre_px[1]) / lens.focal_px[1]], -1)
        rays = np.concatenate([unbend(lens, bent), np.ones((*u.shape, 1))], -1)
        points = pose[:3, 3] + rays @ pose[:3, :3].T * shot.depth[..., None]
        frame["normal_file_path"] = f"normals/{number:04d}.png"
        write_normals(folder / frame["normal_file_path"], _box_normals(points, shot.ids) @ pose[:3, :3] * turn)
    (folder / "transforms.json").write_text(json.dumps(document))
    return folder


def _box_normals(points: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """World normals of points on the room's inside or a box's outside: of the nearest face."""
    normals = np.zeros(points.shape)
    for number, box in ({0: ROOM_BOX} | OBJECTS).items():
        gaps = np.abs(points[..., None, :] - box)  # (h w 2 3): to the lower and upper faces
        face = gaps.reshape(*ids.shape, 6).argmin(-1)
        outwards = np.concatenate([-np.eye(3), np.eye(3)])[face]
        normals[ids == number] = (outwards if number else -outwards)[ids == number]
    return normals


def write_rgbd(folder: Path, views: int = 6, lens: Lens = LENS, change: Callable[[dict], None] = keep) -> Path:
    """An RGB-D capture with ids; `change` edits meta.json before it is written."""
    for number, pose in enumerate(poses(views)):
        shot = see(pose, lens)
        (folder / "color").mkdir(parents=True, exist_ok=True)
        Image.fromarray(shot.image).save(folder / f"color/{number:04d}.jpg", quality=98, subsampling=0)
        write_depth(folder / f"depth/{number:04d}.png", shot.depth)
        write_ids(folder / f"instance/{number:04d}.png", shot.ids)
        (folder / "pose").mkdir(exist_ok=True)
        np.savetxt(folder / f"pose/{number:04d}.txt", pose, fmt="%.8f")
    meta = {"width": lens.width, "height": lens.height, "fx": lens.focal_px[0], "fy": lens.focal_px[1]}
    meta |= {"cx": lens.centre_px[0] - 0.5, "cy": lens.centre_px[1] - 0.5, "depth_scale": 1000.0}
    meta |= {"camera_convention": "OpenCV", "instances": {"1": "crate", "2": "cupboard"}, "instance_unknown": 255}
    change(meta)
    (folder / "meta.json").write_text(json.dumps(meta))
    return folder


def corners() -> PointCloud:
    """The eight corners of the room, as seed points."""
    grid = np.stack(np.meshgrid(*ROOM_BOX.T, indexing="ij"), -1).reshape(-1, 3).astype(np.float32)
    return PointCloud(positions=grid, colours=np.full((8, 3), 200, np.uint8))
