"""All that the command line, the viewer and the log ever hear from a stage."""

from collections.abc import Callable
from dataclasses import dataclass, field

from goc.scene.gaussians import Gaussians


@dataclass(frozen=True, kw_only=True)
class Progress:
    """A stage did `done` of `total` steps."""

    stage: str
    done: int
    total: int
    figures: dict[str, float] = field(default_factory=dict)
    """Current figures worth showing, such as {"PSNR dB": 28.1, "splats": 60000}."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Snapshot:
    """The splats as they are after a step, for whoever watches them grow."""

    stage: str
    step: int
    splats: Gaussians
    """Shares its memory with the optimisation, on the device that it runs on: copy what is to outlive the call."""


@dataclass(frozen=True, kw_only=True)
class Warned:
    """Something a user should know, that did not stop the stage."""

    stage: str
    message: str


Event = Progress | Snapshot | Warned
Listener = Callable[[Event], None]


def ignore(event: Event) -> None:
    """The listener of somebody who does not listen."""
