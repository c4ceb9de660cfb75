"""Curves and pictures of a training: a file of JSON lines always, TensorBoard where it is installed."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from jaxtyping import UInt8

from goc.events import Listener, Warned, ignore
from goc.files import write_png

CURVES = "curves.jsonl"


class Tracker:
    """Writes the curves and pictures of one training: JSON lines, PNG files, and TensorBoard events."""

    def __init__(self, folder: Path, notify: Listener = ignore) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._writer = _writer(folder, notify)

    def scalars(self, step: int, values: dict[str, float]) -> None:
        """Append the value of each named curve at a step."""
        line = msgspec.json.encode({"step": step} | {name: round(value, 6) for name, value in values.items()})
        with (self._folder / CURVES).open("ab") as file:
            file.write(line + b"\n")
        for name, value in values.items():
            if self._writer is not None:
                self._writer.add_scalar(name, value, step)

    def picture(self, step: int, name: str, picture: UInt8[np.ndarray, "h w 3"]) -> None:
        """Replace the picture of that name; TensorBoard keeps the earlier ones."""
        write_png(self._folder / f"{name}.png", picture)
        if self._writer is not None:
            self._writer.add_image(name, picture, step, dataformats="HWC")

    def close(self) -> None:
        """Flush TensorBoard's buffers; nothing can be added afterwards."""
        if self._writer is not None:
            self._writer.close()


def _writer(folder: Path, notify: Listener) -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        message = (
            f"TensorBoard is not installed: curves go to {folder / CURVES} alone. `pip install goc[train]` adds it."
        )
        notify(Warned(stage="train", message=message))
        return None
    return SummaryWriter(str(folder))
