"""Masks of all views → clusters of masks that show one thing: view consensus, and what each voxel belongs to.

After MaskClustering (Yan et al., CVPR 2024), re-derived: two masks are one thing if the views that see both put them in
one mask. Thresholds are majorities here, since views may split and merge things in a third of all cases.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int64
from scipy.sparse import csr_array

from goc.geometry.voxels import connected_parts
from goc.priors.consensus.masks import Masks

VISIBLE = 0.3
"""A view sees a mask if it sees this share of its voxels, or `ENOUGH`."""
ENOUGH = 500
CONTAINED = 0.8
"""A mask lies in another if more than this share of what the view sees of it does; else the view splits it."""
SPLIT = 0.5
"""A mask that is split by more of the views that see it shows several things: it neither is one nor tells of others."""
CONSENSUS = 0.5
"""Masks are one thing if more than this share of the views that see both put them in one mask."""
LEVELS = (95, 80, 65, 50, 35, 20, 5)
"""Percentiles of the number of views that see two masks: how many must agree, round after round; at last one."""
CHUNK = 65536
"""Pairs that are looked at together: what bounds memory."""
MAJORITY = 0.5
"""A voxel is in a cluster if more than this share of the views that see it put it there."""
FEWEST_VOXELS = 12
FEWEST_MASKS = 2
"""Clusters with less are dropped."""
CONSISTENT = 0.5
"""Given ids mean something between views if, in the typical thing, more than this share of its masks has one id."""
TRUST = 2.0
"""That two masks have the same given id counts like so many views, where ids mean something."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Clusters:
    """Things that views agree on, numbered from 0."""

    of_mask: Int64[np.ndarray, "m"]
    """Cluster of each mask; -1 where a mask shows several things or one that no other view confirms."""
    of_voxel: Int64[np.ndarray, "v"]
    """Cluster of each voxel; -1 where views do not agree."""
    count: int
    consistent: bool
    """Whether given ids mean something between views."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Seen:
    """What views see of nodes, which are masks or sets of masks."""

    visible: Bool[np.ndarray, "k f"]
    """Whether a view sees a node."""
    home: Int64[np.ndarray, "k f"]
    """The mask of the view in which it lies; -1 where it is split or not seen."""


def find_clusters(masks: Masks, joined: Int64[np.ndarray, "m"]) -> Clusters:
    """Cluster the masks.

    Args:
        masks: of all views.
        joined: masks of equal number, 0 or above, are known to be one thing; -1 = nothing is known.
    """
    voting = np.flatnonzero(masks.votes)
    covers, views = masks.covers[voting], np.unique(masks.frames[voting], return_inverse=True)[1]
    single = _seen(covers, covers, views)
    whole = ~_split_often(single, views)
    kept = np.flatnonzero(whole | (joined[voting] >= 0))
    nodes, given = _numbered(joined[voting][kept]), masks.given[voting][kept]
    for level in (*np.percentile(_observers(single.visible), LEVELS), 1.0):
        seen = _seen(_union(nodes, covers[kept]), covers, views)
        nodes = _merged(nodes, seen, whole, None, max(level, 1.0))
    consistent = _consistency(nodes[joined[voting][kept] < 0], given[joined[voting][kept] < 0]) > CONSISTENT
    if consistent:
        seen = _seen(_union(nodes, covers[kept]), covers, views)
        nodes = _merged(nodes, seen, whole, given, 1.0)
    of_mask = np.full(len(masks.given), -1)
    of_mask[voting[kept]] = nodes
    trusted = np.zeros(len(masks.given), bool)
    trusted[voting[kept]] = True
    return _settled(masks, of_mask, trusted, consistent)


def _union(nodes: Int64[np.ndarray, "k"], covers: csr_array) -> csr_array:
    """Voxels of each node: those of its masks together."""
    union = (_indicator(nodes, int(nodes.max(initial=-1)) + 1).T @ covers).tocsr()
    union.data[:] = 1.0
    return union


def _consistency(nodes: Int64[np.ndarray, "k"], given: Int64[np.ndarray, "k"]) -> float:
    """Share of masks that have the id of most masks of their node; median of the nodes with at least three masks."""
    pairs, counts = np.unique(np.stack([nodes, given], 1), axis=0, return_counts=True)
    count = int(nodes.max(initial=-1)) + 1
    most, total = np.zeros(count), np.bincount(nodes, minlength=count)
    np.maximum.at(most, pairs[:, 0], counts)
    large = total >= 3
    return float(np.median(most[large] / total[large])) if large.any() else 0.0


def _numbered(joined: Int64[np.ndarray, "k"]) -> Int64[np.ndarray, "k"]:
    """A number for each mask: its own, or that of those it is known to be one thing with."""
    apart = np.where(joined >= 0, joined, joined.max(initial=-1) + 1 + np.arange(len(joined)))
    return np.unique(apart, return_inverse=True)[1].astype(np.int64)


def _indicator(numbers: Int64[np.ndarray, "k"], count: int) -> csr_array:
    """Rows × numbers, 1 where a row has a number."""
    rows = np.flatnonzero(numbers >= 0)
    return csr_array((np.ones(len(rows), np.float32), (rows, numbers[rows])), shape=(len(numbers), count))


def _seen(nodes: csr_array, covers: csr_array, views: Int64[np.ndarray, "m"]) -> _Seen:
    """What each view sees of nodes (sets of voxels), and in which of its masks they lie."""
    count = int(views.max(initial=-1)) + 1
    common = (nodes @ covers.T).tocoo()
    node, mask, shared = common.row, common.col, common.data
    in_view = np.zeros((nodes.shape[0], count), np.float32)
    np.add.at(in_view, (node, views[mask]), shared)
    size = nodes.sum(1)
    visible = (in_view >= np.minimum(VISIBLE * size, ENOUGH)[:, None]) & (in_view > 0)
    home = np.full(in_view.shape, -1)
    held = shared > CONTAINED * in_view[node, views[mask]]
    home[node[held], views[mask[held]]] = mask[held]
    home[~visible] = -1
    return _Seen(visible=visible, home=home)


def _split_often(seen: _Seen, views: Int64[np.ndarray, "m"]) -> Bool[np.ndarray, "m"]:
    """Masks that most of the other views split."""
    own = np.zeros(seen.visible.shape, bool)
    own[np.arange(len(views)), views] = True
    others = seen.visible & ~own
    return (others & (seen.home < 0)).sum(1) > SPLIT * others.sum(1)


def _observers(visible: Bool[np.ndarray, "k f"]) -> Float32[np.ndarray, "n"]:
    """How many views see two masks, of (a sample of) the pairs that any view sees."""
    few = visible[:: max(1, len(visible) // 2000)].astype(np.float32)
    counts = np.triu(few @ few.T, 1)
    return counts[counts > 0] if (counts > 0).any() else np.ones(1, np.float32)


def _merged(
    nodes: Int64[np.ndarray, "k"],
    seen: _Seen,
    whole: Bool[np.ndarray, "m"],
    given: Int64[np.ndarray, "k"] | None,
    level: float,
) -> Int64[np.ndarray, "k"]:
    """Join the nodes that enough views put in one mask; equal given ids have a say too, unless None."""
    count = len(seen.home)
    trusted = (seen.home < 0) | whole[seen.home]
    node, view = np.nonzero((seen.home >= 0) & trusted)
    lies = csr_array((np.ones(len(node), np.float32), (node, seen.home[node, view])), shape=(count, len(whole)))
    support = (lies @ lies.T).tocsr()
    same = csr_array((count, count), dtype=np.float32) if given is None else _same_id(nodes, given)
    pairs = (support + same).tocoo()
    above = pairs.row < pairs.col
    first, second, voices = pairs.row[above], pairs.col[above], pairs.data[above]
    # Where ids have a say, views that split a node are no evidence against it: noise of depth does that to thin things.
    sees = ((seen.visible if given is None else seen.home >= 0) & trusted).astype(np.float32)
    chunks = [slice(at, at + CHUNK) for at in range(0, len(first), CHUNK)]
    observers = np.concatenate([np.zeros(0), *[(sees[first[at]] * sees[second[at]]).sum(1) for at in chunks]])
    observers += np.asarray(same[first, second]).reshape(-1) if len(first) else 0.0
    joins = (voices >= level) & (voices > CONSENSUS * observers)
    return connected_parts(count, first[joins].astype(np.int64), second[joins].astype(np.int64))[nodes]


def _same_id(nodes: Int64[np.ndarray, "k"], given: Int64[np.ndarray, "k"]) -> csr_array:
    """Nodes × nodes: how much equal ids of their masks count."""
    names = np.unique(given, return_inverse=True)[1]
    told = (_indicator(nodes, int(nodes.max()) + 1).T @ _indicator(names, int(names.max()) + 1)).tocsr()
    told = (told / told.sum(1)[:, None]).tocsr()
    return (TRUST * (told @ told.T)).tocsr()


def _settled(masks: Masks, of_mask: Int64[np.ndarray, "m"], whole: Bool[np.ndarray, "m"], consistent: bool) -> Clusters:
    """Give voxels to clusters by majority, and drop clusters that are too small."""
    for _ in range(2):  # masks of dropped clusters stop counting against the others
        count = int(of_mask.max(initial=-1)) + 1
        votes = (masks.covers.T @ _indicator(of_mask, count)).tocoo()
        total = np.asarray(masks.covers[whole].sum(0)).reshape(-1)
        won = votes.data > MAJORITY * total[votes.row]
        of_voxel = np.full(masks.covers.shape[1], -1)
        of_voxel[votes.row[won]] = votes.col[won]
        voxels = np.bincount(of_voxel[of_voxel >= 0], minlength=count)
        members = np.bincount(of_mask[of_mask >= 0], minlength=count)
        keep = (voxels >= FEWEST_VOXELS) & (members >= FEWEST_MASKS)
        renumbered = np.where(keep, np.cumsum(keep) - 1, -1)
        whole = whole & (of_mask >= 0) & keep[of_mask]
        of_mask = np.where(of_mask >= 0, renumbered[of_mask], -1)
        of_voxel = np.where(of_voxel >= 0, renumbered[of_voxel], -1)
    return Clusters(of_mask=of_mask, of_voxel=of_voxel, count=int(keep.sum()), consistent=consistent)
