"""Shaded pictures of meshes on a plain ground, each from the direction that shows it best."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64, UInt8

from goc.geometry.raycast import RayHits, TriangleScene
from goc.geometry.rays import world_rays
from goc.scene import Camera, Mesh

_SUPERSAMPLE = 2
_FOCAL = 2.4
"""Focal length over picture width: a short telephoto lens, as for product photographs."""
_GROUND = np.array([241.0, 241.0, 238.0])
_INSIDE = np.array([118.0, 128.0, 148.0])
"""Colour of the inside of an open surface, whose outside was not measured."""
_NO_COLOUR = 170.0
_LIFT = 26.0
"""Grey level of black surfaces, so that their shape is visible."""
_SKY_RAYS = 6
_REACH, _ROOM_REACH = 0.6, 0.12
"""Distance in radii up to which surfaces darken each other, for objects and for rooms."""
_AZIMUTHS, _ELEVATIONS = 16, (0.35, 0.75)
_TRIAL_PX = 40

Paint = Callable[[Float64[np.ndarray, "n 3"]], Float64[np.ndarray, "n 3"]]
"""Returns the colours, 0 to 255, of n points on a surface."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Subject:
    """A mesh with all that is needed to draw it."""

    scene: TriangleScene
    face_normals: Float64[np.ndarray, "t 3"]
    normals: Float64[np.ndarray, "v 3"]
    colours: Float64[np.ndarray, "v 3"]
    centre: Float64[np.ndarray, "3"]
    radius: float
    up: Float64[np.ndarray, "3"]
    reach: float
    """Distance up to which surfaces darken each other, in the units of the mesh."""
    paint: Paint | None = None
    """Replaces the colours of the vertices; the inside is then mixed half and half with slate blue."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sight:
    """The rays of one picture and what they hit."""

    origins: Float64[np.ndarray, "n 3"]
    rays: Float64[np.ndarray, "n 3"]
    hits: RayHits
    inside: Bool[np.ndarray, "n"]
    """Whether a ray hit the back of a face."""


def portrait(mesh: Mesh, up: Float[np.ndarray, "3"], size: int) -> UInt8[np.ndarray, "size size 3"]:
    """Draw a mesh from slightly above, from the direction that shows most of its outside.

    Args:
        mesh: any frame; open surfaces show their inside in slate blue. Without colours it is grey.
        up: unit vector in the mesh's frame.
        size: width and height, pixels.
    """
    picture = np.tile(_GROUND, (size * size, 1))
    if len(mesh.faces) == 0:
        return picture.reshape(size, size, 3).astype(np.uint8)
    subject = _subject(mesh, up, _REACH)
    direction = max(_directions(up), key=lambda towards: _outside_seen(subject, towards))
    return _picture(subject, direction, size, ground=True)


def dollhouse(mesh: Mesh, up: Float[np.ndarray, "3"], size: int) -> UInt8[np.ndarray, "size size 3"]:
    """Draw a room from above and outside; faces seen from behind (near walls, ceiling) are left out."""
    subject = _subject(mesh, up, _ROOM_REACH)
    directions = [towards for towards in _directions(up) if towards @ up > np.sin(0.5)]
    direction = max(directions, key=lambda towards: _variety(subject, towards))
    return _picture(subject, direction, size, ground=False)


def turntable(
    mesh: Mesh, up: Float[np.ndarray, "3"], size: int, around: Mesh, paint: Paint | None = None, count: int = 3
) -> list[UInt8[np.ndarray, "size size 3"]]:
    """Draw a mesh from several sides with cameras placed for `around`, so that pictures of two meshes match by pixel.

    Args:
        mesh: any frame.
        up: unit vector in the mesh's frame.
        size: width and height, pixels.
        around: the mesh that direction and distance of the cameras are chosen for.
        paint: colours of points on the surface, in place of the vertices'.
        count: number of sides, evenly spaced about up.
    """
    framed = _subject(around, up, _REACH)
    first = max(_directions(up), key=lambda towards: _outside_seen(framed, towards))
    subject = replace(
        _subject(mesh, up, _REACH), centre=framed.centre, radius=framed.radius, reach=framed.reach, paint=paint
    )
    turns = np.arange(count) * 2 * np.pi / count
    return [_picture(subject, _turned(first, subject.up, turn), size, ground=True) for turn in turns]


def _turned(towards: Float64[np.ndarray, "3"], up: Float64[np.ndarray, "3"], angle: float) -> Float64[np.ndarray, "3"]:
    """Rotate a direction about up (Rodrigues' formula)."""
    return np.cos(angle) * towards + np.sin(angle) * np.cross(up, towards) + (1 - np.cos(angle)) * (up @ towards) * up


def _subject(mesh: Mesh, up: Float[np.ndarray, "3"], reach: float) -> _Subject:
    vertices = mesh.vertices.astype(np.float64)
    corners = vertices[mesh.faces]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, mesh.faces[:, corner], faces)
    used = vertices[np.unique(mesh.faces)]
    centre = (used.min(0) + used.max(0)) / 2
    colours = np.full(vertices.shape, _NO_COLOUR) if mesh.colours is None else mesh.colours.astype(np.float64)
    colours = _LIFT + colours * (1.0 - _LIFT / 255.0)
    radius = max(float(np.linalg.norm(used - centre, axis=1).max()), 1e-6)
    return _Subject(
        scene=TriangleScene(mesh.vertices, mesh.faces),
        face_normals=_unit(faces),
        normals=_unit(normals),
        colours=colours,
        centre=centre,
        radius=radius,
        up=np.asarray(up, np.float64),
        reach=reach * radius,
    )


def _directions(up: Float[np.ndarray, "3"]) -> list[Float64[np.ndarray, "3"]]:
    """Unit vectors from the subject towards the cameras that are tried."""
    east, north = _horizontal(np.asarray(up, np.float64))
    found = []
    for elevation in _ELEVATIONS:
        for azimuth in (np.arange(_AZIMUTHS) + 0.5) * 2 * np.pi / _AZIMUTHS:
            level = np.cos(azimuth) * east + np.sin(azimuth) * north
            found.append(np.cos(elevation) * level + np.sin(elevation) * up)
    return found


def _horizontal(up: Float64[np.ndarray, "3"]) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]:
    helper = np.eye(3)[int(np.abs(up).argmin())]
    east = _unit(np.cross(helper, up)[None])[0]
    return east, np.cross(up, east)


def _look(subject: _Subject, towards: Float64[np.ndarray, "3"], size: int, through: bool) -> _Sight:
    """Cast the rays of a square picture; with `through`, rays go on behind faces that are seen from the back."""
    eye = subject.centre + towards * subject.radius * (2 * _FOCAL + 0.3)
    right = _unit(np.cross(subject.up, towards)[None])[0]
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(right, towards), -towards, eye], axis=1)
    camera = Camera(
        focal_px=torch.full((2,), float(_FOCAL * size), dtype=torch.float64),
        centre_px=torch.full((2,), size / 2, dtype=torch.float64),
        width=size,
        height=size,
        world_from_cam=torch.from_numpy(pose),
    )
    origins, rays = world_rays(camera)
    origins, rays = origins.copy(), _unit(rays)
    hits = subject.scene.closest_hit(origins, rays)
    for _ in range(8 if through else 0):
        behind = np.flatnonzero(_from_inside(subject, rays, hits))
        if len(behind) == 0:
            break
        origins[behind] += rays[behind] * (hits.t[behind, None] + 1e-4 * subject.radius)
        further = subject.scene.closest_hit(origins[behind], rays[behind])
        for name in ("t", "triangle", "barycentrics"):
            getattr(hits, name)[behind] = getattr(further, name)
    return _Sight(origins=origins, rays=rays, hits=hits, inside=_from_inside(subject, rays, hits))


def _from_inside(subject: _Subject, rays: Float64[np.ndarray, "n 3"], hits: RayHits) -> Bool[np.ndarray, "n"]:
    """Whether each ray hit the back of a face; False for rays that hit nothing."""
    return hits.found & (np.einsum("ij,ij->i", subject.face_normals[hits.triangle], rays) > 0)


def _outside_seen(subject: _Subject, towards: Float64[np.ndarray, "3"]) -> float:
    """Share of the picture that shows the outside, less twice the share that shows the inside."""
    sight = _look(subject, towards, _TRIAL_PX, through=False)
    return float((sight.hits.found & ~sight.inside).mean() - 2.0 * sight.inside.mean())


def _variety(subject: _Subject, towards: Float64[np.ndarray, "3"]) -> float:
    """Number of different faces in the picture, which is larger for a view into a room than for one onto its walls."""
    sight = _look(subject, towards, _TRIAL_PX, through=True)
    return float(len(np.unique(sight.hits.triangle)))


def _picture(
    subject: _Subject, towards: Float64[np.ndarray, "3"], size: int, ground: bool
) -> UInt8[np.ndarray, "size size 3"]:
    fine = size * _SUPERSAMPLE
    sight = _look(subject, towards, fine, through=not ground)
    picture = np.tile(_GROUND, (fine * fine, 1))
    seen = np.flatnonzero(sight.hits.found)
    picture[seen] = _lit(subject, sight, seen, towards)
    if ground:
        missed = np.flatnonzero(~sight.hits.found)
        picture[missed] *= 1.0 - 0.45 * _shadow(subject, sight, missed)[:, None]
    blocks = picture.reshape(size, _SUPERSAMPLE, size, _SUPERSAMPLE, 3)
    return np.rint(blocks.mean((1, 3))).clip(0, 255).astype(np.uint8)


def _lit(
    subject: _Subject, sight: _Sight, seen: np.ndarray, towards: Float64[np.ndarray, "3"]
) -> Float64[np.ndarray, "n 3"]:
    """Colours of the hit points under a soft key light, a fill light and ambient light from the open sky."""
    corners = subject.scene.faces[sight.hits.triangle[seen]]
    weights = sight.hits.barycentrics[seen][..., None]
    normals = _unit((subject.normals[corners] * weights).sum(1))
    inside = sight.inside[seen]
    normals[inside] *= -1.0
    points = sight.origins[seen] + sight.rays[seen] * sight.hits.t[seen, None]
    if subject.paint is None:
        colours = (subject.colours[corners] * weights).sum(1)
        colours[inside] = _INSIDE
    else:
        colours = subject.paint(points)
        colours[inside] = 0.5 * (colours[inside] + _INSIDE)
    right = np.cross(subject.up, towards)
    key = _unit((0.9 * subject.up + 0.6 * towards - 0.5 * right)[None])[0]
    sky = _open_sky(subject, points, normals)
    light = 0.42 * sky + 0.5 * np.clip(normals @ key, 0, 1) * (0.4 + 0.6 * sky) + 0.2 * np.clip(normals @ towards, 0, 1)
    return colours * light[:, None]


def _open_sky(
    subject: _Subject, points: Float64[np.ndarray, "n 3"], normals: Float64[np.ndarray, "n 3"]
) -> Float64[np.ndarray, "n"]:
    """Share of cosine-distributed rays from each point that leave without hitting anything near (ambient occlusion)."""
    random = np.random.default_rng(0)
    free = np.zeros(len(points))
    starts = points + normals * 2e-3 * subject.radius
    for step in range(_SKY_RAYS):
        # Each pass samples one stratum of the disc, at a random angle for each pixel: little noise from few rays.
        angle = random.random(len(points)) * 2 * np.pi
        height = np.sqrt((step + random.random(len(points))) / _SKY_RAYS)
        ball = np.stack([np.cos(angle) * np.sqrt(1 - height**2), np.sin(angle) * np.sqrt(1 - height**2), height], 1)
        rays = _around(normals, ball)
        free += ~subject.scene.occluded(starts, rays, subject.reach)
    return free / _SKY_RAYS


def _around(normals: Float64[np.ndarray, "n 3"], local: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    """Rotate local vectors into frames whose z axes are the normals (branchless basis, Duff et al. 2017)."""
    x, y, z = normals.T
    sign = np.where(z >= 0, 1.0, -1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    first = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], 1)
    second = np.stack([b, sign + y * y * a, -y], 1)
    return first * local[:, :1] + second * local[:, 1:2] + normals * local[:, 2:]


def _shadow(subject: _Subject, sight: _Sight, missed: np.ndarray) -> Float64[np.ndarray, "n"]:
    """Share of the sky, 0 to 1, that the subject hides from the point where each ray meets the ground."""
    used = subject.scene.vertices[np.unique(subject.scene.faces)] @ subject.up
    rays = sight.rays[missed]
    slope = rays @ subject.up
    t = (used.min() - sight.origins[missed] @ subject.up) / np.where(slope < -1e-6, slope, -1e-6)
    points = sight.origins[missed] + rays * t[:, None]
    near = np.flatnonzero((slope < -1e-6) & (np.linalg.norm(points - subject.centre, axis=1) < 3 * subject.radius))
    dark = np.zeros(len(missed))
    if len(near):
        up = np.tile(subject.up, (len(near), 1))
        dark[near] = 1.0 - _open_sky(subject, points[near], up)
    return dark


def _unit(vectors: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-20)
