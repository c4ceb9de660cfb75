"""The stored result of a run: the schema of result.json."""

import msgspec


class Result(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One measured run, stored as result.json in its folder."""

    run: str
    """Name of the run: room, views, input, method and a hash of the settings."""
    command: str
    """Command line that repeats it."""
    commit: str
    """Commit of goc's source tree, followed by + if it had changes; empty without a source tree."""
    created: str
    """UTC, ISO 8601."""
    seconds: float | None
    """Wall-clock seconds; null for a run that was continued, because its first part was not timed."""
    stages: dict[str, float] = {}
    """Seconds of each stage, in the order in which they ended; a continued run counts only its own part. Empty in older
    results."""
    peak_memory_mb: float | None
    """Peak memory, MB = 10⁶ bytes; null if the run had no process of its own."""
    objects: int
    """Number of objects in the ground truth."""
    found: int
    """Number of these that have a mesh."""
    values: dict[str, float | None]
    """Figures of the observed meshes by metric, as means over the objects; names of figures of the scene start with
    `scene.`; null where one is not finite."""
    completed: dict[str, float | None]
    """Figures of the completed meshes, named as in `values`; empty if there are none."""
