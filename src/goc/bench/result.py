"""What is kept of a run."""

import msgspec


class Result(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One measured run; result.json in its folder."""

    run: str
    """Its name: room, views, input, method and settings."""
    command: str
    """That made it, as a user would type it."""
    commit: str
    """Of goc's source tree, with + where it had changes; empty outside of one."""
    created: str
    """UTC, ISO 8601."""
    seconds: float | None
    """Wall clock; null where a stopped run went on, whose first part nobody timed."""
    stages: dict[str, float] = {}
    """Seconds of each stage, in the order in which they ended; of what a continued run did itself. Empty in results
    of before."""
    peak_memory_mb: float | None
    """MB = 10⁶ bytes; null where the run had no process of its own."""
    objects: int
    """In the ground truth."""
    found: int
    """Of these, with a mesh."""
    values: dict[str, float | None]
    """Of the observed meshes: means over the objects by metric; `scene.` before those of the scene; null where not
    finite."""
    completed: dict[str, float | None]
    """The same of the completed meshes; empty where there are none."""
