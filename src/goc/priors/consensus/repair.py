"""What was wrong with given ids, in words and numbers."""

from dataclasses import dataclass, field


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One kind of fault of masks."""

    count: int
    """How often it was found."""
    views: tuple[str, ...]
    """Names of the first views in which it was found."""


@dataclass(frozen=True, kw_only=True)
class Repair:
    """What `repair_ids` found and did."""

    agreement: float | None
    """Share of the points on objects that neighbouring views give the same id; None where too few are seen twice."""
    repaired: bool
    """Whether ids were made anew; else they are those that were given."""
    consistent: bool = True
    """Whether an id meant the same thing in most views."""
    objects: int = 0
    """Things that were found, where ids were made anew."""
    faults: dict[str, Fault] = field(default_factory=dict[str, Fault])
    """By kind: swaps, drops, merges, splits."""

    @property
    def metrics(self) -> dict[str, float]:
        """Figures for report.json."""
        known = {} if self.agreement is None else {"ids_agreement": self.agreement}
        return known | {f"ids_{kind}": float(fault.count) for kind, fault in self.faults.items()}

    @property
    def sentences(self) -> tuple[str, ...]:
        """What to tell a user, a line each."""
        if not self.repaired:
            return ()
        known = "unknown" if self.agreement is None else f"{100 * self.agreement:.1f} %"
        lines = [
            f"ids of neighbouring views agree in {known} of the objects' points: made anew in 3D from the masks, "
            f"{self.objects} objects. --ids keep trusts what was given."
        ]
        for kind, fault in self.faults.items():
            if fault.count:
                lines.append(f"{_WORDS[kind].format(n=fault.count)}, first in {', '.join(fault.views)}.")
        return tuple(lines)


_WORDS = {
    "swaps": "{n} masks had the id of another object",
    "drops": "{n} masks of objects were missing",
    "merges": "{n} masks covered several objects",
    "splits": "{n} times one object had several ids in a view",
}
