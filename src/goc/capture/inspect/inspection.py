"""What `goc inspect` tells: the nouns of its JSON."""

import msgspec

Vector = tuple[float, float, float]


class Size(msgspec.Struct, frozen=True, kw_only=True):
    """Views of one size."""

    width: int
    height: int
    views: int
    degrees: float
    """Angle of view across the longer side, of the pinhole view that is used."""


class DepthFacts(msgspec.Struct, frozen=True, kw_only=True):
    """Depth that came with the capture."""

    kind: str
    views: int
    """Of those that were looked at."""
    covered: float
    """Share of their pixels that have depth."""
    median_m: float | None
    gap_cm: float | None
    """Median difference of depth where neighbouring views see the same surface; null where it is not metric."""


class FindingFacts(msgspec.Struct, frozen=True, kw_only=True):
    """A check that did not pass."""

    check: str
    severity: str
    message: str


class ViewDamage(msgspec.Struct, frozen=True, kw_only=True):
    """A view that something is wrong with."""

    view: str
    what: str
    """blurred, exposure or pose."""
    detail: str
    """In words."""
    value: float
    """blurred: sharpness, as a share of its neighbours'. exposure: stops off them. pose: cm off them."""


class IdDamage(msgspec.Struct, frozen=True, kw_only=True):
    """An object whose id does not hold still in some views."""

    id: int
    what: str
    """flickers (unlabelled, or part of the room), merges (has the id of another), or splits (has two ids)."""
    other: int | None
    """The other id."""
    views: list[str]


class ObjectFacts(msgspec.Struct, frozen=True, kw_only=True):
    """An object of the ids."""

    id: int
    name: str
    views: int
    """Of those looked at, that show it."""
    largest: float
    """Its largest share of an image."""


class Inspection(msgspec.Struct, frozen=True, kw_only=True):
    """All that was found."""

    path: str
    format: str
    views: int
    looked_at: int
    """Views that were decoded; all, unless they are large."""
    sizes: list[Size]
    lenses: list[str]
    """Projections of the stored images."""
    depth: DepthFacts | None
    has_ids: bool
    objects: list[ObjectFacts]
    seed_points: int
    metric: bool
    units_per_metre: float
    up: Vector
    """Of the cameras, in the capture's world."""
    path_m: float
    """Longest distance between two cameras, metres where `metric`, else guessed metres."""
    findings: list[FindingFacts]
    """Contradictions first."""
    damage: list[ViewDamage]
    ids_damage: list[IdDamage]
    few_views: list[int]
    """Ids of objects that hardly any view shows."""
