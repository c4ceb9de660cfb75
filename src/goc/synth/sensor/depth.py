"""What depth cameras measure: structured light (as in a Kinect), and the lidar of a phone. Depth is z, metres."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import scipy.ndimage
import torch
from jaxtyping import Bool, Float
from scipy.sparse import csr_array

from goc.errors import ConfigError
from goc.geometry.normals import fitted_normals
from goc.scene import Camera
from goc.settings import Amount, Positive, Range, Settings, Share

Depth = Float[np.ndarray, "h w"]
"""z along the optical axis, metres; NaN = none."""
Rng = np.random.Generator


@dataclass(frozen=True, kw_only=True)
class StructuredLight(Settings):
    """A projector and a camera side by side. Defaults after Khoshelham and Elberink 2012, and Nguyen et al. 2012."""

    noise_m: Share = 0.001
    """a of the noise's standard deviation a + b z²."""
    noise_per_m: Share = 0.0019
    """b of it, 1/m."""
    disparity_step: Share = 0.0028
    """Step of 1/z between two depths that can be told apart, 1/m: at z metres they lie z² times this apart."""
    jitter_px: Annotated[float, Range(least=0, most=20)] = 0.5
    """Standard deviation of where a pixel looks, along each axis: frays edges, and leaves planes as they are."""
    grazing_deg: Annotated[float, Range(least=0, most=90)] = 78.0
    """Surfaces whose normal is turned further than this from the ray return nothing; 90 = all are measured."""
    edge_holes: Share = 0.5
    """Share of the pixels beside a jump in depth that are lost."""
    min_m: Amount = 0.4
    """Nothing nearer is measured."""
    max_m: Positive = 5.0
    """Nothing further is measured."""

    def __post_init__(self) -> None:
        """Refuse an empty range of depths."""
        super().__post_init__()
        if self.min_m >= self.max_m:
            raise ConfigError(f"{{min_m}} is {self.min_m:g}: needs less than {{max_m}} ({self.max_m:g}).", type(self))


@dataclass(frozen=True, kw_only=True)
class Lidar(Settings):
    """A lidar with few measured points spread over the image: depth is coarse and smooth, edges become ramps."""

    columns: Annotated[int, Range(least=2, most=8192)] = 64
    """Depths measured across the image; the rows follow from its shape."""
    noise_m: Share = 0.002
    """a of the standard deviation a + b z² of each measured depth."""
    noise_per_m: Share = 0.0008
    """b of it, 1/m."""
    max_m: Positive = 5.0
    """Nothing further is measured."""


_JUMP = 0.04
"""Neighbours whose depths differ by a greater share of the nearer one lie on different surfaces."""


def structured_light_depth(depth: Depth, camera: Camera, config: StructuredLight, rng: Rng) -> Depth:
    """Simulate the depth that a structured-light sensor measures.

    In this order: each pixel reads the true depth up to a few pixels aside (jitter); where the surface grazes the ray,
    at some pixels beside a jump in depth, and out of range, there is nothing; Gaussian noise of standard deviation
    a + b z²; 1/z is rounded to the disparity step. Random numbers are drawn for every effect, whether it is on or not:
    switching one off leaves the others as they were.

    Args:
        depth: exact.
        camera: of the depth image.
        config: strengths; 0 (grazing: 90) switches an effect off.
        rng: all randomness.
    """
    height, width = depth.shape
    shift, lost, noise = (
        rng.standard_normal((2, height, width)),
        rng.random((height, width)),
        rng.normal(size=(height, width)),
    )
    row, column = np.indices(depth.shape)
    row = np.clip(np.rint(row + config.jitter_px * shift[0]), 0, height - 1).astype(int)
    column = np.clip(np.rint(column + config.jitter_px * shift[1]), 0, width - 1).astype(int)
    measured = depth[row, column]
    hole = beside_jump(depth) & (lost < config.edge_holes)
    if config.grazing_deg < 90:
        hole |= incidence(depth, camera) > np.radians(config.grazing_deg)
    measured = np.where(hole, np.nan, measured)
    measured = measured + (config.noise_m + config.noise_per_m * measured**2) * noise
    with np.errstate(invalid="ignore"):
        measured = np.where((measured >= config.min_m) & (measured <= config.max_m), measured, np.nan)
    if config.disparity_step == 0:
        return measured
    levels = np.maximum(np.rint(1 / (measured * config.disparity_step)), 1)
    return 1 / (levels * config.disparity_step)


def lidar_depth(depth: Depth, config: Lidar, rng: Rng) -> Depth:
    """Simulate a phone's lidar depth: 1/z averaged over coarse cells, noise a + b z² a cell, then interpolated.

    Between the middles of cells 1/z is interpolated bilinearly, so that planes stay planes and edges become ramps one
    cell wide. A cell needs half of its pixels; where one of the cells round a pixel has none, there is nothing.
    """
    height, width = depth.shape
    columns = min(config.columns, width)
    rows = max(2, min(height, round(columns * height / width)))
    down, across = _cells(height, rows), _cells(width, columns)
    known = np.isfinite(depth) & (np.nan_to_num(depth) <= config.max_m)
    inverse = np.where(known, 1 / np.where(known, depth, 1.0), 0.0)
    share = down @ known @ across.T
    coarse = 1 / np.where(share > 0, down @ inverse @ across.T / np.maximum(share, 1e-12), 1.0)
    coarse += (config.noise_m + config.noise_per_m * coarse**2) * rng.normal(size=coarse.shape)
    kept = (share >= 0.5) & (coarse > 0)
    low = np.where(kept, 1 / np.where(kept, coarse, 1.0), 0.0)
    rise, run = _between(height, rows), _between(width, columns)
    fine = rise @ low @ run.T
    whole = abs(rise) @ (~kept).astype(float) @ abs(run).T == 0
    return np.where(whole & (fine > 0), 1 / np.where(fine > 0, fine, 1.0), np.nan)


def _cells(pixels: int, cells: int) -> csr_array:
    """Weights (cells pixels) that average equal stretches; a pixel on a border counts for both sides.

    Sparse, because dense products may differ in the last digit with the number of threads.
    """
    edges = np.linspace(0, pixels, cells + 1)
    low, high = np.maximum(edges[:-1, None], np.arange(pixels)), np.minimum(edges[1:, None], np.arange(pixels) + 1)
    return csr_array(np.maximum(high - low, 0) * cells / pixels)


def _between(pixels: int, cells: int) -> csr_array:
    """Weights (pixels cells) of linear interpolation between the middles of cells, continued beyond the outer ones."""
    place = (np.arange(pixels) + 0.5) * cells / pixels - 0.5
    left = np.clip(np.floor(place).astype(int), 0, cells - 2)
    weights = np.zeros((pixels, cells))
    weights[np.arange(pixels), left] = 1 - (place - left)
    weights[np.arange(pixels), left + 1] = place - left
    return csr_array(weights)


def beside_jump(depth: Depth) -> Bool[np.ndarray, "h w"]:
    """Pixels one of whose four neighbours is nearer or further by more than 4 %."""
    filled = np.where(np.isfinite(depth), depth, np.inf)
    cross = scipy.ndimage.generate_binary_structure(2, 1)
    nearest = scipy.ndimage.minimum_filter(filled, footprint=cross, mode="nearest")
    furthest = -scipy.ndimage.minimum_filter(
        -np.where(np.isfinite(depth), depth, -np.inf), footprint=cross, mode="nearest"
    )
    with np.errstate(invalid="ignore"):
        return (furthest - depth > _JUMP * depth) | (depth - nearest > _JUMP * nearest)


def incidence(depth: Depth, camera: Camera) -> Float[np.ndarray, "h w"]:
    """Angle between the surface's normal and the ray, radians; NaN where too little is known to tell."""
    normals = fitted_normals(torch.from_numpy(np.ascontiguousarray(depth, np.float32)), camera, 1)
    rays = torch.nn.functional.normalize(camera.rays(), dim=-1)
    return torch.acos((-(normals * rays).sum(-1)).clamp(-1, 1)).double().numpy()
