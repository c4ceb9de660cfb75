"""How a scan stands: where it was seen from, which way is up, on what it stands. What is not given is looked for."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float64

from goc.complete.config import ScanConfig
from goc.complete.scan_points import chosen, given_normals, typical_spacing, with_normals
from goc.complete.sightline import find_viewpoint, stands_apart
from goc.errors import CompleteError
from goc.geometry.planes import Plane, find_plane
from goc.scene import PointCloud

_LEAST_PLANE = 0.15
"""Share of the points that a support plane must hold to be found."""
_THICK = 3.0
"""Points this many spacings from the support plane are part of it."""
_MOST_BELOW = 0.05
_IN_FRONT = 0.9
"""Least cosine between the axis of a camera and the way to the points: cameras look at what they see."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedScan:
    """A scan turned upright, and what is known of its surroundings; z up, the origin where it was."""

    cloud: PointCloud
    """With unit normals outwards."""
    viewpoints: tuple[Float64[np.ndarray, "3"], ...]
    support: Plane | None
    """What the thing stands on; nothing of it is behind."""
    level_from_scan: Float64[np.ndarray, "3 3"]
    assumed: tuple[str, ...]
    """What was found or taken for granted, in words."""


def posed(cloud: PointCloud, config: ScanConfig) -> PosedScan:
    """Turn a scan upright.

    Args:
        cloud: cleaned, in the frame of its file.
        config: viewpoints, up and support plane, as far as they are known.

    Raises:
        CompleteError: no plane where one was to be found, or normals that look away from every viewpoint.
    """
    viewpoints, seen = _viewpoints(cloud, config)
    cloud, support, stood = _support(cloud, viewpoints, config)
    up, why = _up(cloud, viewpoints, support, config)
    cloud = with_normals(cloud, viewpoints)
    assert cloud.normals is not None
    turn = _level_from(up)
    level = replace(
        cloud,
        positions=(cloud.positions @ turn.T).astype(np.float32),
        normals=(cloud.normals @ turn.T).astype(np.float32),
    )
    return PosedScan(
        cloud=level,
        viewpoints=tuple(turn @ eye for eye in viewpoints),
        support=None if support is None else Plane(turn @ support.normal, support.offset),
        level_from_scan=turn,
        assumed=(seen, *stood, why),
    )


def _viewpoints(cloud: PointCloud, config: ScanConfig) -> tuple[tuple[Float64[np.ndarray, "3"], ...], str]:
    if config.viewpoint:
        given = tuple(np.array(place, np.float64) for place in config.viewpoint)
        return given, f"seen from {len(given)} given place{'s' if len(given) > 1 else ''}"
    if not config.find_viewpoint:
        return (), "seen from anywhere"
    if cloud.seen_from is not None and cloud.seen_from.any() and stands_apart(cloud.positions, cloud.seen_from):
        return (cloud.seen_from,), f"seen from {_words(cloud.seen_from)}, as its file says"
    found = find_viewpoint(cloud.positions, given_normals(cloud), None if config.up is None else _axis(config.up))
    if found is None:
        return (), "seen from several places or unknown ones"
    place, how = found
    if how == "origin":
        return (place,), "seen from the origin, from where no point hides another"
    return (place,), f"one depth image, taken from about {_words(place)}, from where the points are evenly dense"


def _support(
    cloud: PointCloud, viewpoints: tuple[Float64[np.ndarray, "3"], ...], config: ScanConfig
) -> tuple[PointCloud, Plane | None, tuple[str, ...]]:
    if config.support_plane is not None:
        *normal, offset = config.support_plane
        length = float(np.linalg.norm(normal))
        return cloud, Plane(np.array(normal) / length, -offset / length), ("stands on the given plane",)
    if not config.find_support:
        return cloud, None, ()
    oriented = with_normals(cloud, viewpoints)
    assert oriented.normals is not None
    points = cloud.positions.astype(np.float64)
    thick = _THICK * typical_spacing(points)
    plane = find_plane(points, oriented.normals.astype(np.float64), thick, np.random.default_rng(0))
    off = None if plane is None else plane.distance(points)
    if plane is None or off is None or (np.abs(off) <= thick).mean() < _LEAST_PLANE:
        raise CompleteError("--find-support: no plane in the scan holds enough of it. Give --support-plane a b c d.")
    above, below = (off > thick).sum(), (off < -thick).sum()
    if below > above:
        plane, off, above, below = Plane(-plane.normal, -plane.offset), -off, below, above
    if below > _MOST_BELOW * max(above, 1):
        raise CompleteError("--find-support: the scan's largest plane has points on both sides. Give --support-plane.")
    kept = chosen(cloud, np.flatnonzero(off > thick))
    if len(kept.positions) < len(cloud.positions) * 1e-3 or len(kept.positions) < 50:
        raise CompleteError("--find-support: nothing stands on the plane that was found. Leave the flag out.")
    held = int(len(cloud.positions) - len(kept.positions))
    return kept, plane, (f"stands on a plane that {held:,} of its points were",)


def _up(
    cloud: PointCloud, viewpoints: tuple[Float64[np.ndarray, "3"], ...], support: Plane | None, config: ScanConfig
) -> tuple[Float64[np.ndarray, "3"], str]:
    if config.up is not None:
        return _axis(config.up), f"{config.up} points up, as given"
    if support is not None:
        return np.asarray(support.normal, np.float64), "up is across the support plane"
    if len(viewpoints) == 1 and not viewpoints[0].any():
        middle = (cloud.positions.min(axis=0) + cloud.positions.max(axis=0)).astype(np.float64) / 2
        if middle[2] > _IN_FRONT * float(np.linalg.norm(middle)):
            return _axis("-y"), "-y points up, as in a camera's frame (--up changes that)"
    return _axis("z"), "z points up (--up changes that)"


def _axis(name: str) -> Float64[np.ndarray, "3"]:
    return (-1.0 if name[0] == "-" else 1.0) * np.eye(3)["xyz".index(name[-1])]


def _level_from(up: Float[np.ndarray, "3"]) -> Float64[np.ndarray, "3 3"]:
    """Rotation that takes up to z; the identity where it is z."""
    across = np.eye(3)[0] if abs(up[0]) < 0.9 else np.eye(3)[1]
    x = across - (across @ up) * up
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(up, x), up])


def _words(place: Float64[np.ndarray, "3"]) -> str:
    return " ".join(f"{value:.3g}" for value in place)
