"""Splats in the PLY layout of 3D Gaussian Splatting (Kerbl et al. 2023), which viewers open."""

import re
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float32

from goc.errors import FileError
from goc.files.ply import read_ply, write_ply
from goc.scene import Gaussians

_PLACE = ("x", "y", "z")
_BASE = tuple(f"f_dc_{i}" for i in range(3))
_SCALES = tuple(f"scale_{i}" for i in range(3))
_QUATS = tuple(f"rot_{i}" for i in range(4))
_REST_BY_DEGREE = (0, 9, 24, 45, 72)


def write_splats(path: Path, gaussians: Gaussians) -> None:
    """Write splats as binary PLY, atomically: float32 properties, f_rest channel by channel (all of red first).

    Stored are the raw parameters: log scales, opacity logits, quaternions wxyz (of length one, since some viewers do
    not normalise), as other tools expect. Normals are zero, as in the files of the reference implementation.
    Instance features have no place in this layout and are left out.

    Raises:
        FileError: a parameter is not finite (nothing is written), or the disk refuses.
    """
    plain = gaussians.detached()
    rest = plain.sh[:, 1:].transpose(1, 2).flatten(1)
    columns = torch.cat(
        [
            plain.means,
            torch.zeros_like(plain.means),
            plain.sh[:, 0],
            rest,
            plain.opacity_logits[:, None],
            plain.log_scales,
            torch.nn.functional.normalize(plain.quats, dim=-1),
        ],
        1,
    ).to("cpu", torch.float32)
    _check_finite(path, columns.numpy())
    names = [*_PLACE, "nx", "ny", "nz", *_BASE, *(f"f_rest_{i}" for i in range(rest.shape[1])), "opacity"]
    names += [*_SCALES, *_QUATS]
    write_ply(path, {"vertex": {name: columns[:, i].numpy() for i, name in enumerate(names)}})


def read_splats(path: Path) -> Gaussians:
    """Read splats in the same layout, spherical harmonics of degree 0 to 4.

    Raises:
        FileError: missing, malformed, a property lacks, or a parameter is not finite.
    """
    vertex = read_ply(path).get("vertex", {})
    rest_count = sum(re.fullmatch(r"f_rest_\d+", name) is not None for name in vertex)
    if rest_count not in _REST_BY_DEGREE:
        raise FileError(
            f"{path}: {rest_count} f_rest properties belong to no degree of spherical harmonics. Write it again."
        )
    names = [*_PLACE, *_BASE, *(f"f_rest_{i}" for i in range(rest_count)), "opacity", *_SCALES, *_QUATS]
    missing = [name for name in names if not isinstance(vertex.get(name), np.ndarray)]
    if missing:
        raise FileError(
            f"{path}: {len(missing)} properties of a splat file are missing (first: {missing[0]}). "
            "Expected the layout of 3D Gaussian Splatting, uncompressed."
        )
    with np.errstate(over="ignore"):  # doubles beyond float32 become infinite and are refused as such
        columns = np.stack([np.asarray(vertex[name]).astype(np.float32) for name in names], 1)
    _check_finite(path, columns)
    table = torch.from_numpy(columns)
    means, base, rest, opacity, scales, quats = table.split([3, 3, rest_count, 1, 3, 4], 1)
    if not (quats.norm(dim=1) > 0).all():
        raise FileError(f"{path}: {(quats.norm(dim=1) == 0).sum()} splats have a zero rotation. Write it again.")
    sh = torch.cat([base[:, None], rest.reshape(len(table), 3, rest_count // 3).transpose(1, 2)], 1)
    return Gaussians(
        means=means.contiguous(),
        quats=quats.contiguous(),
        log_scales=scales.contiguous(),
        opacity_logits=opacity[:, 0].contiguous(),
        sh=sh.contiguous(),
    )


def _check_finite(path: Path, columns: Float32[np.ndarray, "n columns"]) -> None:
    bad = ~np.isfinite(columns).all(1)
    if bad.any():
        first = int(np.flatnonzero(bad)[0])
        raise FileError(
            f"{path}: {bad.sum()} of {len(bad)} splats are not finite (first: {first}). Nothing can draw them."
        )
