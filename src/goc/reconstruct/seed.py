"""The first splats: from depth, else from stereo, else from the capture's points, else from the scene box."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial import cKDTree
from torch import Tensor

from goc.errors import ReconstructError
from goc.geometry.harmonics import BAND_0
from goc.geometry.inpaint import filled
from goc.geometry.normals import normals_from_depth
from goc.geometry.rotations import quats_towards
from goc.reconstruct.config import ReconstructConfig
from goc.scene.capture import Capture, Frame
from goc.scene.gaussians import Gaussians
from goc.scene.priors import CoarseDepth

_POOL = 12
"""Candidates back-projected for each splat of the budget."""
_TEXTURE_SHARE = 0.5
"""Share of the seeds drawn where the image has texture; the rest covers the surface evenly."""
_FEWEST_MATCHES = 1000
"""Photographs that match in fewer pixels than this say nothing."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Points:
    """Surface samples in the world, with how much detail their images show."""

    positions: Float[Tensor, "p 3"]
    colours: Float[Tensor, "p 3"]
    normals: Float[Tensor, "p 3"]
    detail: Float[Tensor, "p"]
    opacity: Float[Tensor, "p"]

    def __getitem__(self, index: Tensor) -> "_Points":
        return _Points(
            positions=self.positions[index],
            colours=self.colours[index],
            normals=self.normals[index],
            detail=self.detail[index],
            opacity=self.opacity[index],
        )


def splat_budget(capture: Capture, config: ReconstructConfig) -> int:
    """How many splats there may be: `config.mcmc.max_splats`, but no more than the largest view has pixels."""
    pixels = max(camera.width * camera.height for camera in capture.cameras)
    return min(config.mcmc.max_splats, max(pixels, 1000))


def seed(capture: Capture, views: list[int], config: ReconstructConfig) -> Gaussians:
    """Place the first splats on what the views say of the surface.

    Args:
        capture: its depth, else the stereo of its priors, else its points, else the box its cameras look into. Where
            stereo was asked for there are few points, if any; where photographs do not match, the box is next.
        views: indices of the views that may be looked at (those not held out).
        config: budget, opacity and shape of the seeds.

    Raises:
        ReconstructError: fewer than four usable points.
    """
    generator = torch.Generator().manual_seed(config.seed)
    budget, seeding = splat_budget(capture, config), config.seeding
    if capture.has_depth:
        points = _thin(_from_depth(capture, views, budget * _POOL, seeding.opacity), budget, generator)
    elif capture.priors is not None and capture.priors.stereo is not None:
        points = _from_stereo(capture, views, config, generator)
    elif capture.points is not None and len(capture.points.positions):
        points = _from_cloud(capture, budget, seeding.opacity, generator)
    else:
        points = _from_box(capture, views, seeding.random_points, generator)
    if len(points.positions) < 4:
        raise ReconstructError(
            f"only {len(points.positions)} points to start from in {len(views)} views: "
            "check that depth images are not empty and poses are camera-to-world."
        )
    return _splats(points, config)


def _detail(image: Float[Tensor, "h w 3"]) -> Float[Tensor, "h w"]:
    """Local contrast: gradient magnitude of the grey image, spread over 5 pixels."""
    grey = image.mean(-1)[None, None]
    padded = torch.nn.functional.pad(grey, (1, 1, 1, 1), mode="replicate")
    along_x, along_y = padded[..., 1:-1, 2:] - padded[..., 1:-1, :-2], padded[..., 2:, 1:-1] - padded[..., :-2, 1:-1]
    magnitude = (along_x.square() + along_y.square()).sqrt()
    return torch.nn.functional.avg_pool2d(magnitude, 5, 1, 2)[0, 0]


def _of_frame(frame: Frame, pixels: Tensor, opacity: float) -> _Points:
    """Back-project the given pixels (flat indices); those without depth or normal are dropped."""
    depth = frame.depth
    assert depth is not None
    camera_normals = normals_from_depth(depth, frame.camera) if frame.normals is None else frame.normals
    normals = (camera_normals @ frame.camera.world_from_cam[:3, :3].T).reshape(-1, 3)[pixels]
    image = frame.image.float() / 255.0
    found = _Points(
        positions=frame.camera.unproject_depth(depth).reshape(-1, 3)[pixels],
        colours=image.reshape(-1, 3)[pixels],
        normals=normals,
        detail=_detail(image).reshape(-1)[pixels],
        opacity=torch.full((len(pixels),), opacity),
    )
    return found[torch.isfinite(found.positions).all(-1) & torch.isfinite(found.normals).all(-1)]


def _from_depth(capture: Capture, views: list[int], wanted: int, opacity: float) -> _Points:
    """About `wanted` surface samples, the same number from each view, on a jittered grid of pixels."""
    found = []
    for view in views:
        frame = capture[view]
        if frame.depth is None:
            continue
        pixels = frame.camera.width * frame.camera.height
        step = max(1, pixels * len(views) // wanted)
        start = (view * 7919) % step  # another phase in each view
        found.append(_of_frame(frame, torch.arange(start, pixels, step), opacity))
    return _joined(found)


def _from_stereo(capture: Capture, views: list[int], config: ReconstructConfig, generator: torch.Generator) -> _Points:
    """Stereo's surface, and between it a share of less certain points; the scene box where photographs do not match."""
    assert capture.priors is not None and capture.priors.stereo is not None
    seeding, budget, stereo = config.seeding, splat_budget(capture, config), capture.priors.stereo
    step = max(1, sum(view.depth.numel() for view in stereo.values()) // (budget * _POOL))
    sure = [_of_stereo(capture, view, found, step, seeding.opacity) for view, found in stereo.items()]
    trusted = _joined(sure)
    if len(trusted.positions) < _FEWEST_MATCHES:
        return _from_box(capture, views, seeding.random_points, generator)
    between = [_of_stereo(capture, view, _between(found), step, seeding.fill_opacity) for view, found in stereo.items()]
    share = round(budget * seeding.fill_share)
    return _joined([_thin(trusted, budget - share, generator), _thin(_joined(between), share, generator)])


def _of_stereo(capture: Capture, view: int, found: CoarseDepth, step: int, opacity: float) -> _Points:
    """Every `step`-th pixel of a coarse depth map that has depth and a normal."""
    size, seen = (found.camera.height, found.camera.width), capture[view]
    image = torch.nn.functional.interpolate(seen.image.float().permute(2, 0, 1)[None], size, mode="area")[0]
    depth = found.depth
    if seen.valid is not None:
        shown = torch.nn.functional.interpolate(seen.valid[None, None].float(), size, mode="area")[0, 0] == 1
        depth = torch.where(shown, depth, torch.nan)
    frame = Frame(camera=found.camera, image=image.permute(1, 2, 0).round().byte(), depth=depth)
    pixels = torch.arange((view * 7919) % step, size[0] * size[1], step)  # another phase in each view
    return _of_frame(frame, pixels, opacity)


def _between(found: CoarseDepth) -> CoarseDepth:
    """Depth where nothing was trusted: inverse depth spread smoothly from where it was."""
    inverse = filled(1.0 / found.depth)
    hole = ~torch.isfinite(found.depth) & torch.isfinite(inverse)
    return replace(found, depth=torch.where(hole, 1.0 / inverse, torch.nan))


def _joined(parts: list[_Points]) -> _Points:
    none = torch.zeros(0, 3)
    parts = [_Points(positions=none, colours=none, normals=none, detail=none[:, 0], opacity=none[:, 0]), *parts]
    return _Points(**{name: torch.cat([getattr(p, name) for p in parts]) for name in _Points.__dataclass_fields__})


def _voxel_keys(positions: Float[Tensor, "p 3"], voxel: float) -> np.ndarray:
    cells = torch.floor((positions - positions.amin(0)) / voxel).long()
    size = cells.amax(0) + 1
    return ((cells[:, 0] * size[1] + cells[:, 1]) * size[2] + cells[:, 2]).numpy()


def _one_a_voxel(points: _Points, count: int) -> Tensor:
    """One sample in each cell of the voxel grid that has about `count` occupied cells (found by bisection)."""
    low, high = 1e-4, float((points.positions.amax(0) - points.positions.amin(0)).max()) + 1e-3
    while high / low > 1.01:
        middle = (low * high) ** 0.5
        cells = _voxel_keys(points.positions, middle)
        cells.sort()
        occupied = 1 + np.count_nonzero(np.diff(cells))
        low, high = (middle, high) if occupied > count else (low, middle)
    return torch.from_numpy(np.unique(_voxel_keys(points.positions, high), return_index=True)[1])


def _thin(points: _Points, budget: int, generator: torch.Generator) -> _Points:
    """Half of the budget evenly over the surface, half where the images show detail."""
    if len(points.positions) <= budget:
        return points
    shuffled = points[torch.randperm(len(points.positions), generator=generator)]
    even = _one_a_voxel(shuffled, round(budget * (1 - _TEXTURE_SHARE)))
    weight = shuffled.detail.clone() + 1e-4
    weight[even] = 0.0
    # Samples of one voxel compete: detail is counted a surface cell, not a view that looked at it.
    spacing = 0.25 * _spacing(shuffled.positions[even]).median().item()
    cells, counts = np.unique(_voxel_keys(shuffled.positions, spacing), return_inverse=True, return_counts=True)[1:]
    weight /= torch.from_numpy(counts[cells]).float()
    chosen = torch.multinomial(weight, max(1, min(budget - len(even), len(weight) - len(even))), generator=generator)
    return shuffled[torch.cat([even, chosen])]


def _spacing(positions: Float[Tensor, "p 3"]) -> Float[Tensor, "p"]:
    """Root mean square distance to the three nearest neighbours, as 3DGS sizes its seeds."""
    distances, _ = cKDTree(positions.numpy()).query(positions.numpy(), k=4)
    return torch.from_numpy(np.sqrt((distances[:, 1:] ** 2).mean(-1))).float().clamp_min(1e-5)


def _from_cloud(capture: Capture, budget: int, opacity: float, generator: torch.Generator) -> _Points:
    cloud = capture.points
    assert cloud is not None
    count = len(cloud.positions)
    keep = torch.randperm(count, generator=generator)[:budget]
    normals = torch.zeros(count, 3) if cloud.normals is None else torch.from_numpy(cloud.normals)
    return _Points(
        positions=torch.from_numpy(cloud.positions),
        colours=torch.from_numpy(cloud.colours).float() / 255.0,
        normals=normals,
        detail=torch.zeros(count),
        opacity=torch.full((count,), opacity),
    )[keep]


def _from_box(capture: Capture, views: list[int], count: int, generator: torch.Generator) -> _Points:
    """Random points along random pixels' rays, 0.5 to 8 m away, in the colour of their pixel."""
    found = []
    each = max(1, count // len(views))
    for view in views:
        frame = capture[view]
        pixels = torch.randint(0, frame.camera.width * frame.camera.height, (each,), generator=generator)
        # Uniform in inverse depth, as pixels are.
        near, far = 0.5 * capture.units_per_metre, 8.0 * capture.units_per_metre
        depth = 1.0 / (1.0 / far + torch.rand(each, generator=generator) * (1.0 / near - 1.0 / far))
        directions = frame.camera.rays().reshape(-1, 3)[pixels] * depth[:, None]
        points = _Points(
            positions=frame.camera.in_world(directions),
            colours=frame.image.reshape(-1, 3)[pixels].float() / 255.0,
            normals=torch.zeros(each, 3),
            detail=torch.zeros(each),
            opacity=torch.full((each,), 0.1),
        )
        found.append(points if frame.valid is None else points[frame.valid.reshape(-1)[pixels]])
    return _joined(found)


def _splats(points: _Points, config: ReconstructConfig) -> Gaussians:
    """Discs on the surface where the normal is known, balls elsewhere."""
    count = len(points.positions)
    width = 0.7 * _spacing(points.positions)
    oriented = points.normals.norm(dim=-1) > 0.5
    thickness = torch.where(oriented, config.seeding.flatness, 1.0)
    scales = torch.stack([width, width, width * thickness], -1)
    sh = torch.zeros(count, (config.sh_degree + 1) ** 2, 3)
    sh[:, 0] = (points.colours - 0.5) / BAND_0
    up = torch.tensor([0.0, 0.0, 1.0])
    return Gaussians(
        means=points.positions.contiguous(),
        quats=quats_towards(torch.where(oriented[:, None], points.normals, up)),
        log_scales=scales.log(),
        opacity_logits=torch.logit(points.opacity),
        sh=sh,
    )
