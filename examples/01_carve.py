"""Carve a room: photographs with known cameras go in, separate watertight objects come out.

    python examples/01_carve.py [FOLDER]

FOLDER (default: out/example) gets the photographs of a made-up room (FOLDER/room) and what goc makes of them
(FOLDER/carved, described in docs/guide/output.md). Later examples use both. Half a minute on two cores.
"""

import sys
from dataclasses import replace
from pathlib import Path

from goc.complete import CompleteConfig
from goc.events import Event, Warned
from goc.export import ExportConfig
from goc.pipeline import PRESETS, carve
from goc.synth.captures import RoomConfig, make_room_capture


def tell(event: Event) -> None:
    """Print warnings; progress comes by here too."""
    if isinstance(event, Warned):
        print(f"{event.stage}: {event.message}")


def main(folder: Path) -> None:
    """Photograph a furnished room, and carve it."""
    room, carved = folder / "room", folder / "carved"
    if not room.exists():
        make_room_capture(room, RoomConfig(views=12, width=96, height=96, objects=6, samples=2))

    # Small and quick: 100 steps instead of 2,000, and unseen surface from the evidence instead of a network.
    # carve(room, carved) alone has the settings of `goc carve`.
    fast = PRESETS["fast"]
    config = replace(
        fast,
        reconstruct=replace(fast.reconstruct, iterations=100),
        complete=CompleteConfig(method="hull"),
        export=ExportConfig(overwrite=True),
    )
    scene = carve(room, carved, config, notify=tell)

    print(f"{len(scene.objects)} objects: {', '.join(str(item.id) for item in scene.objects)}")
    print(f"look at {carved / 'overview.png'}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/example"))
