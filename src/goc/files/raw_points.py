"""Points as a file holds them, of any type, and what they become: finite, in single precision, colours in bytes."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float64, Shaped, UInt8

from goc.errors import FileError
from goc.files.offsets import recentred
from goc.scene import Mesh, PointCloud

_NO_COLOUR = 128  # mid grey, sRGB


@dataclass(frozen=True, kw_only=True, eq=False)
class RawPoints:
    """Points in the frame and the types of their file."""

    positions: Float[np.ndarray, "p 3"]
    """Not finite where the sensor measured nothing."""
    colours: Shaped[np.ndarray, "p 3"] | None = None
    """Bytes, 16 bits, or numbers from 0 to 1 or 255."""
    normals: Shaped[np.ndarray, "p 3"] | None = None
    seen_from: Float64[np.ndarray, "3"] | None = None
    remarks: tuple[str, ...] = ()
    """What was left out, in words."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Scan:
    """A partial scan, and what became of it on the way out of its file."""

    surface: Mesh | PointCloud
    """About a nearby origin."""
    offset: Float64[np.ndarray, "3"]
    """What to add to a position to have it in the file's frame; zeros unless that is far away."""
    remarks: tuple[str, ...] = ()
    """What was left out or moved, in words."""


def scan_of(path: Path, raw: RawPoints) -> Scan:
    """Points that say where they are, moved near their origin; all normals are left out if one has no direction.

    Raises:
        FileError: no point is left, or far away they lost their digits.
    """
    known = np.isfinite(raw.positions).all(axis=1)
    if not known.any():
        raise FileError(f"{path}: holds no points. Write the file again.")
    remarks = raw.remarks
    if not known.all():
        remarks = (*remarks, f"{(~known).sum():,} of its {len(known):,} points have no finite place: left out")
    positions, offset = recentred(path, raw.positions[known])
    if not np.isfinite(positions).all():
        raise FileError(f"{path}: its coordinates are beyond single precision. Choose another unit.")
    normals = None if raw.normals is None else raw.normals[known].astype(np.float32)
    if normals is not None and not np.isfinite(normals).all():
        normals, remarks = None, (*remarks, "some normals are not finite: all are estimated anew")
    cloud = PointCloud(
        positions=positions,
        colours=as_bytes(raw.colours, len(known))[known],
        normals=normals,
        seen_from=None if raw.seen_from is None else raw.seen_from - offset,
    )
    return placed(cloud, offset, remarks)


def placed(surface: Mesh | PointCloud, offset: Float64[np.ndarray, "3"], remarks: tuple[str, ...] = ()) -> Scan:
    """A scan whose origin lies at `offset`; says so if that is elsewhere."""
    if offset.any():
        place = " ".join(f"{value:g}" if abs(value) < 1e5 else f"{value:.0f}" for value in offset)
        remarks = (*remarks, f"far from its origin: computed about {place}")
    return Scan(surface=surface, offset=offset, remarks=remarks)


def as_bytes(colours: Shaped[np.ndarray, "p 3"] | None, count: int) -> UInt8[np.ndarray, "{count} 3"]:
    """Colours as sRGB bytes, whatever they are stored as; mid grey where there are none.

    Bytes stay. Wider integers are of 16 bits if any is above 255. Numbers reach to 1, or to 255 if any is above 1.
    """
    if colours is None:
        return np.full((count, 3), _NO_COLOUR, np.uint8)
    if colours.dtype == np.uint8:
        return colours
    if colours.dtype.kind in "iu":
        return (np.clip(colours, 0, 65535) >> (8 if colours.size and colours.max() > 255 else 0)).astype(np.uint8)
    values = np.nan_to_num(colours.astype(np.float64), nan=0.0, posinf=0.0, neginf=0.0)
    scale = 255.0 if not values.size or values.max() <= 1.0 else 1.0
    return np.rint(np.clip(values * scale, 0, 255)).astype(np.uint8)


def noted(raw: RawPoints, words: str) -> RawPoints:
    """The same points with one more remark."""
    return replace(raw, remarks=(*raw.remarks, words))
