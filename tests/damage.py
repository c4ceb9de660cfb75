"""Ways in which captures come broken: each takes the folder of a sound capture and spoils it."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

Damage = Callable[[Path], None]
FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Kind:
    """One kind of damage, and what the user must hear of it."""

    name: str
    spoil: Damage
    says: str
    """Regular expression: of the error, or of a warning where `refused` is False."""
    refused: bool = True


def document(folder: Path) -> dict:
    """The transforms.json."""
    return json.loads((folder / "transforms.json").read_text())


def edit(change: Callable[[dict], None]) -> Damage:
    """Change the JSON of a nerfstudio folder."""

    def spoil(folder: Path) -> None:
        changed = document(folder)
        change(changed)
        rewrite(folder / "transforms.json", json.dumps(changed).encode())

    return spoil


def keys(**values: object) -> Damage:
    """Set keys at the top of the JSON; None removes one."""

    def change(changed: dict) -> None:
        for key, value in values.items():
            changed[key] = value
            if value is None:
                del changed[key]

    return edit(change)


def poses(change: Callable[[np.ndarray], np.ndarray]) -> Damage:
    """Change the stack of poses of a nerfstudio folder."""

    def spoil(changed: dict) -> None:
        stack = np.array([frame["transform_matrix"] for frame in changed["frames"]])
        for frame, matrix in zip(changed["frames"], change(stack), strict=True):
            frame["transform_matrix"] = np.asarray(matrix).tolist()

    return edit(spoil)


def frames(**values: object) -> Damage:
    """Set keys of the fourth frame."""
    return edit(lambda changed: changed["frames"][3].update(values))


def depths(change: Callable[[np.ndarray], np.ndarray]) -> Damage:
    """Change all depth images, given in millimetres."""
    return images(
        "depth", lambda stored: np.clip(change(stored.astype(np.float64)), 0, 65535).round().astype(np.uint16)
    )


def ids(change: Callable[[np.ndarray], np.ndarray]) -> Damage:
    """Change all id images."""
    return images("instance", change)


def images(kind: str, change: Callable[[np.ndarray], np.ndarray]) -> Damage:
    """Change all images of a folder."""

    def spoil(folder: Path) -> None:
        for path in sorted((folder / kind).iterdir()):
            save(path, change(np.array(Image.open(path))))

    return spoil


def one(name: str, data: bytes | None) -> Damage:
    """Replace a file, or remove it."""

    def spoil(folder: Path) -> None:
        rewrite(folder / name, data)

    return spoil


def cut(name: str) -> Damage:
    """Keep the first 60 % of a file."""

    def spoil(folder: Path) -> None:
        data = (folder / name).read_bytes()
        rewrite(folder / name, data[: len(data) * 6 // 10])

    return spoil


def both(*parts: Damage) -> Damage:
    """Several kinds at once."""

    def spoil(folder: Path) -> None:
        for part in parts:
            part(folder)

    return spoil


def save(path: Path, pixels: np.ndarray) -> None:
    """Write an image; the old file may be shared with other tests, so it is not written into."""
    path.unlink(missing_ok=True)
    Image.fromarray(np.ascontiguousarray(pixels)).save(path)


def rewrite(path: Path, data: bytes | None) -> None:
    """Replace a file, which may be shared with other tests; None removes it."""
    path.unlink()
    if data is not None:
        path.write_bytes(data)


def rays(size: tuple[int, int], changed: dict) -> np.ndarray:
    """Length of the rays with z = 1 of a nerfstudio camera."""
    x = (np.arange(size[0]) + 0.5 - changed["cx"]) / changed["fl_x"]
    y = (np.arange(size[1]) + 0.5 - changed["cy"]) / changed["fl_y"]
    return np.sqrt(1 + x**2 + y[:, None] ** 2)


def moved(factor: float) -> Damage:
    """Positions times a factor."""

    def change(stack: np.ndarray) -> np.ndarray:
        stack = stack.copy()
        stack[:, :3, 3] *= factor
        return stack

    return poses(change)


def distances(folder: Path) -> None:
    """Depth along each pixel's ray."""
    changed = document(folder)
    lengths = rays((changed["w"], changed["h"]), changed)
    depths(lambda stored: stored * lengths)(folder)


def pairs_as_text(folder: Path) -> None:
    """Names 1 … 12 without leading zeros, whose poses were paired in the order of names as text."""
    changed = document(folder)
    listed = changed["frames"]
    order = sorted(range(len(listed)), key=lambda number: str(number + 1))
    matrices = [frame["transform_matrix"] for frame in listed]
    for number, frame in enumerate(listed):
        frame["transform_matrix"] = matrices[order.index(number)]
        for key in ("file_path", "depth_file_path", "instance_file_path"):
            old = folder / frame[key]
            new = old.with_name(f"{number + 1}.png")
            old.rename(new)
            frame[key] = str(new.relative_to(folder))
    rewrite(folder / "transforms.json", json.dumps(changed).encode())
