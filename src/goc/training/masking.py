"""Partial observations of training shapes: the paper's visible mask, and the evidence that the same cameras give.

Depth is ray-cast, degraded as splats and sensors degrade it, and fused by the code that fuses real captures.
"""

from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

import numpy as np
import torch
from jaxtyping import Bool, Float32, Float64, Int16

from goc.complete import SIDE, Cube, PartialObject, bounding_cube, partial_object
from goc.errors import ConfigError
from goc.extract import ExtractConfig
from goc.fusion.depth_views import DepthView
from goc.fusion.evidence import evidence_block_grid, evidence_grid
from goc.fusion.volume import Volume
from goc.geometry.rays import world_rays
from goc.scene import Camera, EvidenceGrid
from goc.settings import Amount, CountOrNone, Range, Settings, Share
from goc.synth.noise import fractal_noise
from goc.training.cuts import CutConfig, cut_in_half, with_contact_planes, without_empty
from goc.training.placement import PlacedShape, random_placement
from goc.training.surroundings import Surroundings, no_surroundings, random_surroundings
from goc.training.viewpoints import Regime, random_viewpoints
from goc.training.watertight_shape import WatertightShape

Random = np.random.Generator
_OBJECT, _OTHER = 1, 2
_GRAZING = 0.12
"""Cosine below which a pixel is not trusted, as fusion of real depth does not."""
_FAR = 10.0
"""Depth of rays that meet nothing, in longest sides."""
_SLACK = 1e-3
"""How much nearer than a point a ray to it may end for the point to be seen, in the object's longest sides."""
_UNCUT = np.array([0.0, 0.0, 0.0, np.inf])
"""A plane beyond which there is nothing."""
_BAND = 3.0 / 128.0
"""Truncation of the evidence of real objects, in longest sides: three voxels of 128."""


@dataclass(frozen=True, kw_only=True)
class MaskConfig(Settings):
    """How an object is seen in training. Lengths are in longest sides of the object."""

    strategy: Literal["visible", "random", "none"] = "visible"
    """visible: what cameras see (the paper's choice). random: half of the points. none: the whole surface. Table 6."""
    size_px: Annotated[int, Range(least=8, most=4096)] = 72
    """Side of the virtual depth images."""
    arc: Share = 0.35
    """Share of objects seen in 1 to 6 views on an arc."""
    room: Share = 0.3
    """Share seen in 8 to 17 views as a room is scanned."""
    front: Share = 0.25
    """Share seen in 1 to 4 views from the front, against a wall or in a corner, as cupboards and beds are; what is left
    is seen from all round, alone."""
    noise: Amount = 1.0
    """Strength of depth noise, bias, flying pixels and wrong ids; 0: exact depth."""
    cuts: CutConfig = field(default_factory=CutConfig)
    """What is left out of that, or told beyond it."""
    points: CountOrNone = 0
    """Points of the seen surface to keep; 0 where the network takes evidence alone."""
    jitter: Annotated[float, Range(least=0, below=1)] = 0.04
    """How far the cube is shifted and scaled from where the rule puts it, in units of its side."""

    def __post_init__(self) -> None:
        """Refuse shares that are more than the whole."""
        super().__post_init__()
        if self.arc + self.room + self.front > 1 + 1e-9:
            shares = f"{{arc}} is {self.arc:g}, {{room}} {self.room:g} and {{front}} {self.front:g}"
            text = f"{shares}: needs shares that are at most 1 together."
            raise ConfigError(text, type(self))


@dataclass(frozen=True, kw_only=True, eq=False)
class VirtualView:
    """One depth image, rendered by a virtual camera."""

    at: Camera
    depth: Float32[np.ndarray, "h w"]
    """z along the optical axis, world units; NaN where there is none."""
    slope: Float32[np.ndarray, "h w"]
    """Cosine between ray and surface normal; NaN where the depth is not trusted."""
    ids: Int16[np.ndarray, "h w"]

    def for_fusion(self) -> DepthView:
        """The view as the fusion engine takes it."""
        return DepthView(
            depth=self.depth,
            slope=self.slope,
            ids=self.ids,
            colours=None,
            camera=self.at,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class MaskedObject:
    """A placed shape, what the cameras tell of it, and the cube that both are normalised by."""

    placed: PlacedShape
    cube: Cube
    partial: PartialObject
    views: int
    regime: str


def mask(solid: WatertightShape, config: MaskConfig, random: Random) -> MaskedObject | None:
    """Place a shape at random, render it, and keep what was seen; None where fewer than 60 pixels hit it."""
    placed, yaw = random_placement(solid, random)
    regime, count = _regime(config, random)
    if config.strategy != "visible":
        regime, count = "sphere", 20
    around = no_surroundings() if regime == "sphere" else random_surroundings(placed, yaw, random, regime == "front")
    viewpoints = random_viewpoints(placed.box(), around, regime, count, config.size_px, random)
    taken = [render_view(placed, around, viewpoint) for viewpoint in viewpoints]
    seen = _hit_points(taken, placed)
    if len(seen) < 60:
        return None
    noisy = add_depth_noise(taken, placed, config.noise, random)
    if random.random() < config.cuts.bare:
        noisy = [_of_object_alone(view) for view in noisy]
    wide = random.random() < config.cuts.wide
    pad = float(random.uniform(0.1, 0.5) if wide else random.uniform(0.02, 0.2))
    evidence = _evidence(noisy, seen, pad, int(random.integers(86, 104)), wide)
    if random.random() < config.cuts.contacts:
        reach = float(np.ptp(seen, axis=0).max())
        slack = random.normal(0, 0.004 * reach, len(around.contacts))
        evidence = with_contact_planes(evidence, around.contacts, slack)
    if random.random() < config.cuts.forget_empty:
        evidence = without_empty(evidence)
    cut = _UNCUT
    if random.random() < config.cuts.halves:
        evidence, cut = cut_in_half(evidence, seen, random)
        seen, wide = seen[seen @ cut[:3] <= cut[3]], True
    cube = _jittered(bounding_cube(seen, float(random.uniform(SIDE, 1.8)) if wide else SIDE), config, random)
    points, normals = _seen_surface(placed, around, taken, cut, config, random)
    partial = partial_object(points, normals, evidence, cube)
    return MaskedObject(placed=placed, cube=cube, partial=partial, views=len(taken), regime=regime)


def _regime(config: MaskConfig, random: Random) -> tuple[Regime, int]:
    draw = random.random()
    if draw < config.arc:
        return "arc", int(random.integers(1, 7))
    if draw < config.arc + config.room:
        return "room", int(random.integers(8, 18))
    if draw < config.arc + config.room + config.front:
        return "front", int(random.integers(1, 5))
    return "sphere", int(random.integers(12, 21))


def render_view(placed: PlacedShape, around: Surroundings, at: Camera) -> VirtualView:
    """Render exact depth and ids. A ray that hits nothing gets a far depth, so that the space along it is empty."""
    origins, directions = world_rays(at)
    hits, normals = placed.closest_hit(origins, directions)
    length = np.linalg.norm(directions, axis=-1)
    slope = np.abs((normals * directions).sum(-1)) / length
    depth, ids = np.where(hits.found, hits.t, _FAR), np.where(hits.found, _OBJECT, _OTHER)
    slope = np.where(hits.found, slope, 1.0)
    if around.scene is not None:
        other = around.scene.closest_hit(origins, directions)
        nearer = other.t < depth
        depth, ids, slope = np.where(nearer, other.t, depth), np.where(nearer, _OTHER, ids), np.where(nearer, 1, slope)
    shape = (at.height, at.width)
    slope = np.where(slope < _GRAZING, np.nan, slope)
    return VirtualView(
        at=at,
        depth=depth.astype(np.float32).reshape(shape),
        slope=slope.astype(np.float32).reshape(shape),
        ids=ids.astype(np.int16).reshape(shape),
    )


def add_depth_noise(
    views: list[VirtualView], placed: PlacedShape, strength: float, random: Random
) -> list[VirtualView]:
    """Degrade exact depth to what splats and sensors give.

    Adds a smooth bias that all views share (splats lie off the surface), a small offset for each view, noise for each
    pixel, flying pixels and wrong ids at silhouettes, and holes. `strength` scales all of them.
    """
    if strength <= 0 or random.random() < 0.15:
        return views
    low, high = placed.box()
    reach = float((high - low).max())
    common = strength * reach * random.choice([0.0, random.uniform(0, 0.006), random.uniform(0, 0.015)])
    own = strength * reach * random.uniform(0, 0.003)
    grain = strength * reach * random.choice([random.uniform(0, 0.002), random.uniform(0, 0.005)])
    flying, holes = strength * random.uniform(0, 0.4), strength * random.choice([0.0, random.uniform(0, 0.1)])
    waves, offset = random.uniform(4, 20) / reach, random.uniform(0, 60, 3)
    noisy = []
    for view in views:
        origins, directions = world_rays(view.at)
        flat = view.depth.ravel().astype(np.float64)
        known = np.isfinite(flat)
        where = origins[known] + directions[known] * flat[known, None]
        flat[known] += common * 2 * (fractal_noise(where * waves + offset, 2) - 0.5) * 2
        flat[known] += random.normal(0, own) + random.normal(0, grain, known.sum())
        depth = flat.reshape(view.depth.shape).astype(np.float32)
        ids, slope = view.ids.copy(), view.slope.copy()
        edge = _silhouette(ids)
        chosen = edge & (random.random(edge.shape) < flying)
        depth[chosen] = (depth + random.random(edge.shape) * (np.roll(depth, 1, 1) - depth))[chosen]
        ids[edge & (random.random(edge.shape) < 0.5 * flying)] = random.choice([_OBJECT, _OTHER])
        slope[chosen & (random.random(edge.shape) < 0.7)] = np.nan
        depth[random.random(edge.shape) < holes] = np.nan
        slope[np.isnan(depth)] = np.nan  # as fusion has it: a pixel without depth says nothing
        noisy.append(VirtualView(at=view.at, depth=depth, slope=slope, ids=ids))
    return noisy


def _silhouette(ids: Int16[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    edge = np.zeros(ids.shape, bool)
    across, down = ids[:, 1:] != ids[:, :-1], ids[1:] != ids[:-1]
    edge[:, 1:] |= across
    edge[:, :-1] |= across
    edge[1:] |= down
    edge[:-1] |= down
    return edge


def _hit_points(views: list[VirtualView], placed: PlacedShape) -> Float64[np.ndarray, "p 3"]:
    found = [np.zeros((0, 3))]
    for view in views:
        origins, directions = world_rays(view.at)
        own = (view.ids == _OBJECT).ravel() & np.isfinite(view.slope).ravel()
        found.append(origins[own] + directions[own] * view.depth.ravel()[own, None].astype(np.float64))
    return np.concatenate(found)


def _of_object_alone(view: VirtualView) -> VirtualView:
    """The view without depth wherever it does not show the object."""
    depth, slope = (np.where(view.ids == _OBJECT, field, np.float32(np.nan)) for field in (view.depth, view.slope))
    return replace(view, depth=depth, slope=slope)


def _jittered(cube: Cube, config: MaskConfig, random: Random) -> Cube:
    jitter = config.jitter
    shift = random.uniform(-jitter, jitter, 3) * cube.side
    return Cube(centre=cube.centre + shift, side=cube.side * float(random.uniform(1 - jitter, 1 + 3 * jitter)))


def _evidence(
    views: list[VirtualView], seen: Float64[np.ndarray, "p 3"], pad: float, cells: int, uncut: bool = False
) -> EvidenceGrid:
    """Fuse views as `goc.extract` does for a real object, on a somewhat coarser grid with the same band.

    `uncut` keeps all of the padding, also where no ray passed.
    """
    longest = float(np.ptp(seen, axis=0).max())
    config = ExtractConfig(
        evidence_cells=cells,
        evidence_pad=pad * longest,
        truncation_voxels=max(2.0, _BAND * cells / (1 + 2 * pad)),
        finest_voxel=1e-6,
    )
    points = seen.astype(np.float32)
    volume = Volume(evidence_block_grid(points, 1.0, config))
    for view in views:
        volume.add(view.for_fusion(), wanted=_OBJECT)
    if uncut:
        room = np.float32(config.evidence_pad)
        points = np.stack([points.min(axis=0) - room, points.max(axis=0) + room])
    return evidence_grid(volume, points, config)


def _seen_surface(
    placed: PlacedShape,
    around: Surroundings,
    views: list[VirtualView],
    cut: Float64[np.ndarray, "4"],
    config: MaskConfig,
    random: Random,
) -> tuple[Float32[np.ndarray, "p 3"], Float32[np.ndarray, "p 3"]]:
    """P_s with normals: uniform samples of the surface, those that no camera sees left out, and Gaussian noise."""
    if config.points == 0:
        return np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32)
    points, normals = placed.surface(4 * config.points, int(random.integers(2**31)))
    keep = points @ cut[:3] <= cut[3]
    if config.strategy == "visible":
        keep &= np.any([visible(points, view.at, placed, around) for view in views], 0)
    elif config.strategy == "random":
        keep &= random.random(len(points)) < 0.5
    rows = np.flatnonzero(keep)
    if len(rows) == 0:
        rows = np.arange(len(points))
    rows = random.choice(rows, config.points, replace=len(rows) < config.points)
    low, high = placed.box()
    sigma = config.noise * random.uniform(0, 0.006) * float((high - low).max())
    return (points[rows] + random.normal(0, sigma, (len(rows), 3))).astype(np.float32), normals[rows].astype(np.float32)


def visible(
    points: Float64[np.ndarray, "p 3"], at: Camera, placed: PlacedShape, around: Surroundings
) -> Bool[np.ndarray, "p"]:
    """Which points of an object's surface a camera sees: in its image, and with nothing on the line to them."""
    seen = at.sees(torch.from_numpy(points)).numpy()
    directions = points[seen] - at.position.numpy()
    origins = np.broadcast_to(at.position.numpy(), directions.shape)
    low, high = placed.box()
    nearest = 1.0 - _SLACK * float((high - low).max()) / np.linalg.norm(directions, axis=1)
    hits, _ = placed.closest_hit(origins, directions)
    hidden = hits.found & (hits.t < nearest)
    if around.scene is not None:
        other = around.scene.closest_hit(origins, directions)
        hidden |= other.found & (other.t < nearest)
    seen[seen] = ~hidden
    return seen
