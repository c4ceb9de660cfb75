"""Merges parts into objects: legs, aprons, backs and shelves join the support that they carry or surround."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int64
from scipy.spatial import cKDTree

from goc.geometry.voxels import connected_parts
from goc.priors.segmentation.room_planes import RoomPlanes
from goc.priors.segmentation.supports import BELOW, Support, reach_of
from goc.priors.segmentation.surface_voxels import SurfaceVoxels

ABOVE = 0.85
"""A part with this share of its voxels above a face stands on it, or rises from its rim."""
RIM_SHARE = 0.15
"""A part that runs along this share of a face's rim belongs to it: the front of a counter, the back of a chair."""
SEAT_RIM_SHARE = 0.03
"""The same where the face is no higher than a seat and the part rises past it from below: arms and backs."""
SEAT_M = 0.55
"""No seat is higher above the floor, metres, and hardly a table lower."""
UNDER_M = 0.12
"""Legs end at most so far below the face they carry, metres: what is between may never have been seen."""
HANGS_M = 0.15
"""What hangs in the air belongs to the seat next to it, so near, metres."""
CLOSE_M = 0.04
"""What ends so close below a face, metres, carries it, wherever it begins: an apron, a drawer. So wide are cracks."""
RISES_M = 0.05
"""What rises higher than this above a face, metres, and beside it is a thing of its own: a chair at a table."""
BROAD = 0.8
"""A part touches another broadly from this many voxels on, in units of the square root of its size."""
SMALL_PART = 12
"""A part of fewer voxels joins the part that it touches most."""


@dataclass(frozen=True, eq=False)
class PartGraph:
    """PartGraph of what is not room, cut at faces and below their rims, and the pairs of voxels at which they touch."""

    surface: SurfaceVoxels
    room: RoomPlanes
    units_per_metre: float
    supports: list[Support]
    ids: Int64[np.ndarray, "v"]
    """Part of each voxel: bodies from 0 on, then the supports; -1 = none."""
    column: Bool[np.ndarray, "v"]
    """Whether the voxel lies below a support."""
    cells: Int64[np.ndarray, "v 2"]
    touching: tuple[Int64[np.ndarray, "e"], Int64[np.ndarray, "e"]]
    """Rows of voxels of different parts that are neighbours, each pair both ways."""
    grounded: Bool[np.ndarray, "q"]
    """Whether each part touches floor, wall or ceiling."""

    def merged(self) -> Int64[np.ndarray, "v"]:
        """Number of the thing of each voxel: legs, aprons, backs and shelves joined to their supports; -1 = none."""
        links = [(self.bodies + n, part) for n in range(len(self.supports)) for part in self._carriers_of(n)]
        links += self._across_rims({part: face - self.bodies for face, part in links})
        links += self._floating_parts(links)
        small = self.sizes < SMALL_PART
        links = [(a, b) for a, b in links if not (small[a] or small[b])] + self._small_parts(small)
        pairs = np.array(links, np.int64).reshape(-1, 2)
        things = connected_parts(len(self.sizes), pairs[:, 0], pairs[:, 1])
        return np.where(self.ids >= 0, things[self.ids], -1)

    @cached_property
    def sizes(self) -> Int64[np.ndarray, "q"]:
        """Voxels a part."""
        return np.bincount(self.ids[self.ids >= 0], minlength=self.bodies + len(self.supports))

    @cached_property
    def bodies(self) -> int:
        """How many parts are not supports."""
        return int(self.ids.max(initial=-1)) + 1 - len(self.supports)

    def _carriers_of(self, number: int) -> list[int]:
        """Bodies that belong to a support."""
        support = self.supports[number]
        above = self._share(support.plane.distance(self.surface.points) > BELOW * self.surface.voxel)
        found = set(self._legs(support, above))
        own, other = self.touching
        for part, at in self._grouped(other[self.ids[own] == self.bodies + number]):
            if self.column[at].all() and above[part] < 1 - ABOVE:
                found.add(part)
        seat = self._is_seat(support)
        for part, at in self._grouped(self._near(support)):
            low_back = seat and bool(above[part] < ABOVE)
            if self._rim_share(support, at, low_back) >= (SEAT_RIM_SHARE if low_back else RIM_SHARE):
                found.add(part)
        return sorted(found)

    def _share(self, chosen: Bool[np.ndarray, "v"]) -> Float[np.ndarray, "q"]:
        """Share of each part's voxels that are chosen."""
        return np.bincount(self.ids[chosen & (self.ids >= 0)], minlength=len(self.sizes)) / np.maximum(self.sizes, 1)

    def _grouped(self, rows: Int64[np.ndarray, "m"]) -> list[tuple[int, Int64[np.ndarray, "k"]]]:
        """The bodies among some voxels, each with its rows."""
        rows = rows[self.ids[rows] < self.bodies]
        return [(int(part), rows[self.ids[rows] == part]) for part in np.unique(self.ids[rows])]

    def _is_seat(self, support: Support) -> bool:
        """Whether a face is no higher than people sit: what rises at its rim from below is its arm or back."""
        floor = self.room.floor
        return floor is not None and bool(
            floor.distance(self.surface.points[support.rows]).mean() < SEAT_M * self.units_per_metre
        )

    def _near(self, support: Support) -> Int64[np.ndarray, "m"]:
        """Rows of bodies near a face, cracks between the two included."""
        span = UNDER_M * self.units_per_metre
        rows = np.flatnonzero((self.ids >= 0) & (self.ids < self.bodies))
        rows = rows[np.abs(support.plane.distance(self.surface.points[rows])) < span]
        distance, _ = cKDTree(self.surface.points[support.rows]).query(
            self.surface.points[rows], distance_upper_bound=span
        )
        return rows[np.isfinite(distance)]

    def _rim_share(self, support: Support, at: Int64[np.ndarray, "m"], wide: bool) -> float:
        """Share of a face's rim that runs along the voxels `at`; `wide` bridges the crack behind a seat."""
        reach = max(2, round(CLOSE_M * self.units_per_metre / self.surface.voxel) + 1 if wide else 2)
        rim = support.footprint.rim()
        distance, _ = cKDTree(self.cells[at]).query(rim, distance_upper_bound=reach + 0.5, p=np.inf)
        return float(np.isfinite(distance).mean())

    def _legs(self, support: Support, above: Float[np.ndarray, "q"]) -> list[int]:
        """Bodies below a face that end just under it, or stand on the floor and end under it, the joint unseen."""
        rows = np.flatnonzero((self.ids >= 0) & self.column)
        rows = rows[reach_of(support, self.surface, self.units_per_metre).holds(self.cells[rows])]
        found = []
        for part, mine in self._grouped(rows):
            inside = support.footprint.holds(self.cells[mine]).sum()
            if above[part] > 1 - ABOVE or len(mine) < 0.8 * self.sizes[part] or inside < 0.5 * self.sizes[part]:
                continue
            gap = -support.plane.distance(self.surface.points[mine]).max() / self.units_per_metre
            foot = (
                self.room.floor.distance(self.surface.points[mine]).min() / self.units_per_metre
                if self.room.floor
                else np.inf
            )
            if gap < CLOSE_M or (gap < UNDER_M and foot < UNDER_M):
                found.append(part)
        return found

    def _across_rims(self, carriers: dict[int, int]) -> list[tuple[int, int]]:
        """Bodies cut in two below a rim, joined again.

        What reaches below a face without carrying it, such as the seat of a chair, belongs to what it touches outside.
        What carries the face may go on outside, too: a foot plate, a drawer.
        """
        ins, outs = self.touching
        cut = self.column[ins] & ~self.column[outs] & (self.ids[ins] < self.bodies) & (self.ids[outs] < self.bodies)
        ins, outs = ins[cut], outs[cut]
        links = []
        for a, b in np.unique(np.stack([self.ids[ins], self.ids[outs]], 1), axis=0).tolist():
            at = outs[(self.ids[ins] == a) & (self.ids[outs] == b)]
            if a not in carriers or self._continues(b, at, self.supports[carriers[a]]):
                links.append((a, b))
        return links

    def _continues(self, part: int, at: Int64[np.ndarray, "m"], support: Support) -> bool:
        """Whether a body outside continues what carries the face: it touches broadly and stays below."""
        rows = np.flatnonzero(self.ids == part)
        rises = (support.plane.distance(self.surface.points[rows]) > RISES_M * self.units_per_metre).mean() > 1 - ABOVE
        return bool(not rises and len(np.unique(at)) >= BROAD * np.sqrt(len(rows)))

    def _floating_parts(self, links: list[tuple[int, int]]) -> list[tuple[int, int]]:
        """Bodies that cannot stand alone, joined to what is next to them.

        They lie wholly below a face and touch nothing, such as the legs of a sofa, or they hang in the air over or
        beside a face no higher than a seat, such as its cushions. (Beside a table it may be the back of a chair that
        hangs there, its legs never seen.)
        """
        carried, seated = self._carried_and_seated(links)
        a, b = (self.ids[rows] for rows in self.touching)
        free = ~carried[a] & ~carried[b]
        heaps = connected_parts(len(self.sizes), a[free], b[free])
        held = np.zeros(len(self.sizes), bool)
        held[heaps[self.grounded & ~carried]] = True
        firm = carried & (self.sizes >= SMALL_PART) & ~seated
        firm[self.bodies :] = True
        held[heaps[a[~carried[a] & firm[b]]]] = True
        below = ~carried & (self._share(self.column) == 1)
        below[a] = False
        seated[self.bodies :] = [self._is_seat(support) for support in self.supports]
        joined = self._nearest(below, carried, UNDER_M)
        return joined + self._nearest(~carried & ~held[heaps] & (self.sizes >= SMALL_PART), seated, HANGS_M)

    def _carried_and_seated(self, links: list[tuple[int, int]]) -> tuple[Bool[np.ndarray, "q"], Bool[np.ndarray, "q"]]:
        """Whether each part is one with some support, and with one no higher than a seat."""
        pairs = np.array(links, np.int64).reshape(-1, 2)
        things = connected_parts(len(self.sizes), pairs[:, 0], pairs[:, 1])
        seats = [self._is_seat(support) for support in self.supports]
        faces = things[self.bodies :]
        return np.isin(things, faces), np.isin(things, faces[np.array(seats, bool)])

    def _nearest(
        self, chosen: Bool[np.ndarray, "q"], hosts: Bool[np.ndarray, "q"], reach_m: float
    ) -> list[tuple[int, int]]:
        """Each chosen body with the host next to it, if one is near enough."""
        rows = np.flatnonzero((self.ids >= 0) & chosen[self.ids])
        host_rows = np.flatnonzero((self.ids >= 0) & hosts[self.ids])
        if not len(rows) or not len(host_rows):
            return []
        distance, nearest = cKDTree(self.surface.points[host_rows]).query(
            self.surface.points[rows], distance_upper_bound=reach_m * self.units_per_metre
        )
        joined = []
        for part, mine in self._grouped(rows):
            at = np.searchsorted(rows, mine)
            best = at[distance[at].argmin()]
            if np.isfinite(distance[best]):
                joined.append((part, int(self.ids[host_rows[nearest[best]]])))
        return joined

    def _small_parts(self, small: Bool[np.ndarray, "q"]) -> list[tuple[int, int]]:
        """Links of small parts to the one larger part that they touch most."""
        speck, other = (self.ids[rows] for rows in self.touching)
        chosen = small[speck] & ~small[other]
        pairs, counts = np.unique(np.stack([speck[chosen], other[chosen]], 1), axis=0, return_counts=True)
        order = np.lexsort((pairs[:, 1], -counts, pairs[:, 0]))
        _, first = np.unique(pairs[order, 0], return_index=True)
        return [(int(a), int(b)) for a, b in pairs[order][first]]
