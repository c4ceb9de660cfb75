"""Capture → the same capture with ids that mean the same thing in every view."""

from dataclasses import replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Int64
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from goc.events import Listener, Warned, ignore
from goc.priors.consensus.agreement import agreement
from goc.priors.consensus.clusters import Clusters, find_clusters
from goc.priors.consensus.masks import Masks, find_masks
from goc.priors.consensus.relabel import RepairedIds, parts_of_masks
from goc.priors.consensus.repair import Fault, Repair
from goc.priors.segmentation.config import SegmentConfig
from goc.priors.segmentation.id_field import IdField
from goc.priors.segmentation.room_planes import find_room_planes
from goc.priors.segmentation.stage import CACHE_BYTES, REACH, SegmentedFrames
from goc.priors.segmentation.surface_voxels import (
    SurfaceVoxels,
    back_project,
    by_name,
    depth_of,
    fuse_depth,
    thinned,
)
from goc.scene import ROOM, UNLABELLED, Capture, ViewCache

IdsMode = Literal["auto", "keep", "repair"]

AGREES = 0.95
"""Ids of which neighbouring views agree so far are kept as they are; noise of real depth costs right ones 2 to 3 %."""
ROOM_SHARE, ROOM_SAME = 0.05, 0.7
"""Id 0 is the room if it covers this share of what is seen, and what it covers is 0 in so many of the views."""
ON_PLANES = 0.6
"""Without a given room, a thing is room if more than this share of it lies on planes of the room."""
LISTED = 3
"""Views that are named for each kind of fault."""


def repair_ids(
    views: Capture, mode: IdsMode, config: SegmentConfig, notify: Listener = ignore
) -> tuple[Capture, Repair]:
    """Give every thing one id in all views, whatever ids its masks had: view consensus (docs/decisions/0049).

    Masks of different views are one thing if most views that see the surface of both put it into one mask. Masks that
    are right keep their outlines; those that cover several things, and what was left out, are labelled pixel by pixel.

    Args:
        views: any capture; one without metric depth or without ids is handed on.
        mode: keep: ids stay as they are. repair: they are made anew. auto: unless neighbouring views agree on them.
        config: how depth is fused.
        notify: hears of progress, and of what was wrong with the ids, one warning a kind.

    Returns:
        The capture, and what was found.

    Raises:
        SegmentError: no surface shows in the depth.
    """
    if mode == "keep" or not (views.has_metric_depth and views.has_ids):
        return views, Repair(agreement=None, repaired=False)
    agrees = agreement(views)
    if mode == "auto" and (agrees is None or agrees >= AGREES):
        return views, Repair(agreement=agrees, repaired=False)
    surface = thinned(fuse_depth(views, config, ignore))
    reach = _reach(views, surface)
    masks = find_masks(views, surface, reach, notify)
    given_room = _given_room(masks)
    clusters = find_clusters(masks, np.where(given_room, 0, -1))
    ids = _new_ids(masks, clusters, _room_of(views, surface, config, masks, clusters, given_room))
    repaired = _with_ids(views, surface, reach, masks, clusters, ids)
    report = Repair(
        agreement=agrees,
        repaired=True,
        consistent=clusters.consistent,
        objects=int((np.unique(ids) != ROOM).sum()),
        faults=_faults(views, masks, clusters, ids),
    )
    for sentence in report.sentences:
        notify(Warned(stage="ids", message=sentence))
    return repaired, report


def _given_room(masks: Masks) -> Bool[np.ndarray, "m"]:
    """Masks of the room, where the given id 0 means the room; else none."""
    voting = masks.votes
    zero = masks.given == ROOM
    covered = np.asarray(masks.covers[zero].sum(0)).reshape(-1)
    seen = np.asarray(masks.covers[voting].sum(0)).reshape(-1)
    share = covered.sum() / max(seen.sum(), 1.0)
    same = (covered * covered).sum() / max((covered * seen).sum(), 1.0)
    return zero & bool(share >= ROOM_SHARE and same >= ROOM_SAME)


def _reach(views: Capture, surface: SurfaceVoxels) -> float:
    """How far from a voxel points may lie, in voxels: three standard deviations of the depth of some views."""
    order, tree, found = by_name(views), cKDTree(surface.points), [np.zeros(0)]
    for index in order[:: max(1, len(order) // 8)]:
        z = depth_of(views[index])
        if z is not None:
            stride = max(1, max(z.shape) // 24)
            points = back_project(z, views.cameras[index], stride)[np.isfinite(z[::stride, ::stride])]
            away, nearest = tree.query(points, distance_upper_bound=REACH[1] * surface.voxel)
            near = np.isfinite(away)
            offset = points[near] - surface.points[nearest[near]]
            found.append(np.abs((offset * surface.normals[nearest[near]]).sum(1)))
    gaps = np.concatenate(found)
    noise = 1.4826 * float(np.median(gaps)) if len(gaps) else 0.0
    return float(np.clip(3.0 * noise / surface.voxel, *REACH))


def _room_of(
    views: Capture,
    surface: SurfaceVoxels,
    config: SegmentConfig,
    masks: Masks,
    clusters: Clusters,
    given_room: Bool[np.ndarray, "m"],
) -> Bool[np.ndarray, "k"]:
    """Which clusters are the room: the given one, or without it, those that lie on its planes."""
    if given_room.any():
        return np.isin(np.arange(clusters.count), clusters.of_mask[given_room])
    cameras = tuple(views.cameras[index] for index in by_name(views))
    room = find_room_planes(surface, cameras, views.units_per_metre, np.random.default_rng(config.seed))
    labelled = clusters.of_voxel >= 0
    inside = np.bincount(clusters.of_voxel[room.mask & labelled], minlength=clusters.count)
    return inside > ON_PLANES * np.bincount(clusters.of_voxel[labelled], minlength=clusters.count)


def _new_ids(masks: Masks, clusters: Clusters, room: Bool[np.ndarray, "k"]) -> Int64[np.ndarray, "k"]:
    """Id of each cluster: that of the room, the given one that most of its masks carry, or a number by size."""
    ids = np.where(room, ROOM, -1)
    size = np.bincount(clusters.of_voxel[clusters.of_voxel >= 0], minlength=clusters.count)
    order = np.argsort(-size, kind="stable")
    if clusters.consistent:
        taken: set[int] = set()
        of = clusters.of_mask >= 0
        pairs = np.stack([clusters.of_mask[of], masks.given[of]], 1)
        unique, counts = np.unique(pairs, axis=0, return_counts=True)
        for row in np.argsort(-counts, kind="stable"):
            cluster, given = int(unique[row, 0]), int(unique[row, 1])
            if ids[cluster] < 0 and given > ROOM and given not in taken:
                ids[cluster] = given
                taken.add(given)
    left = [int(cluster) for cluster in order if ids[cluster] < 0]
    first = int(masks.given.max(initial=0)) + 1 if clusters.consistent else 1
    ids[left] = first + np.arange(len(left))
    return ids


def _with_ids(
    views: Capture,
    surface: SurfaceVoxels,
    reach: float,
    masks: Masks,
    clusters: Clusters,
    ids: Int64[np.ndarray, "k"],
) -> Capture:
    """The capture with new ids."""
    of_voxel = np.where(clusters.of_voxel >= 0, ids[clusters.of_voxel], UNLABELLED)
    known: dict[int, dict[int, int]] = {}
    for mask in np.flatnonzero(clusters.of_mask >= 0):
        view = known.setdefault(int(masks.frames[mask]), {})
        view[int(masks.given[mask])] = int(ids[clusters.of_mask[mask]])
    below = RepairedIds(below=views.frames, field=IdField(surface, of_voxel, reach), known=known)
    frames = SegmentedFrames(below=views.frames, ids=ViewCache(below, CACHE_BYTES))
    names = {key: name for key, name in views.id_names.items() if key == ROOM or (clusters.consistent and key in ids)}
    return replace(views, frames=frames, id_names=names)


def _faults(views: Capture, masks: Masks, clusters: Clusters, ids: Int64[np.ndarray, "k"]) -> dict[str, Fault]:
    """Count the faults of all views' masks, by the voxels that they share with the clusters."""
    rows = np.flatnonzero(clusters.of_voxel >= 0)
    things = csr_array(
        (np.ones(len(rows)), (rows, clusters.of_voxel[rows])), shape=(len(clusters.of_voxel), clusters.count)
    )
    table = (masks.covers @ things).toarray().astype(np.int64)
    found: dict[str, list[str]] = {kind: [] for kind in ("swaps", "drops", "merges", "splits")}
    for index in by_name(views):
        mine = np.flatnonzero(masks.frames == index)
        for kind, count in _faults_of_view(
            table[mine], masks.given[mine], clusters.of_mask[mine], ids, clusters.consistent
        ).items():
            found[kind] += [views.view_names[index]] * count
    return {kind: Fault(count=len(where), views=tuple(dict.fromkeys(where))[:LISTED]) for kind, where in found.items()}


def _faults_of_view(
    table: Int64[np.ndarray, "m k"],
    given: Int64[np.ndarray, "m"],
    of_mask: Int64[np.ndarray, "m"],
    ids: Int64[np.ndarray, "k"],
    consistent: bool,
) -> dict[str, int]:
    """Faults of one view's masks (rows) on things (columns)."""
    doubtful = (given != UNLABELLED) & (of_mask < 0)
    parts = parts_of_masks(table, doubtful) & (table >= 4)
    objects = ids != ROOM
    shown = given > ROOM
    if not consistent:
        shown = given != UNLABELLED
    single = shown & (parts.sum(1) == 1)
    main = ids[table.argmax(1)] if table.size else np.zeros(len(given), int)
    lost = parts[~shown][:, objects].any(0) if (~shown).any() else np.zeros(int(objects.sum()), bool)
    return {
        "swaps": int((single & (main != given)).sum()) if consistent else 0,
        "drops": int(lost.sum()),
        "merges": int((parts[shown].sum(1) > 1).sum()),
        "splits": int((parts[shown][:, objects].sum(0) > 1).sum()),
    }
