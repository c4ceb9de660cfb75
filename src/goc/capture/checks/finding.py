"""What a check found: a contradiction, which is refused, or a doubt, which is told."""

from dataclasses import dataclass
from typing import Literal

Severity = Literal["contradiction", "doubt"]


@dataclass(frozen=True)
class Finding:
    """One line about a capture: what is wrong with it, and what to do."""

    check: str
    """The check that found it, such as `depth-agreement`; for programs."""
    severity: Severity
    message: str
    """Cause and remedy, without the path of the capture."""


def contradiction(check: str, message: str) -> Finding:
    """A finding that no capture can have and be right."""
    return Finding(check, "contradiction", message)


def doubt(check: str, message: str) -> Finding:
    """A finding that is more often a mistake than not."""
    return Finding(check, "doubt", message)
