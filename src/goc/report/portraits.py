"""Pictures of meshes: each from its own best angle, lit, on a neutral ground."""

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
"""Focal length over picture width: a mild tele, as for product photographs."""
_GROUND = np.array([241.0, 241.0, 238.0])
_INSIDE = np.array([118.0, 128.0, 148.0])
"""The inside of an open surface: nobody measured the outside there."""
_NO_COLOUR = 170.0
_LIFT = 26.0
"""Black things are drawn this bright, so that their shape shows."""
_SKY_RAYS = 6
_REACH, _ROOM_REACH = 0.6, 0.12
"""Nearer than this, in radii, surfaces take light from each other."""
_AZIMUTHS, _ELEVATIONS = 16, (0.35, 0.75)
_TRIAL_PX = 40

Paint = Callable[[Float64[np.ndarray, "n 3"]], Float64[np.ndarray, "n 3"]]
"""Colours of points on a surface, 0 … 255."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Subject:
    """A mesh ready to be looked at."""

    scene: TriangleScene
    face_normals: Float64[np.ndarray, "t 3"]
    normals: Float64[np.ndarray, "v 3"]
    colours: Float64[np.ndarray, "v 3"]
    centre: Float64[np.ndarray, "3"]
    radius: float
    up: Float64[np.ndarray, "3"]
    reach: float
    """How far surfaces darken each other."""
    paint: Paint | None = None
    """Colours in place of the vertices'; the inside then keeps half of them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sight:
    """What the rays of one picture met."""

    origins: Float64[np.ndarray, "n 3"]
    rays: Float64[np.ndarray, "n 3"]
    hits: RayHits
    inside: Bool[np.ndarray, "n"]
    """Rays that met the back of a face."""


def portrait(mesh: Mesh, up: Float[np.ndarray, "3"], size: int) -> UInt8[np.ndarray, "size size 3"]:
    """Picture a mesh from where most of its outside shows, slightly from above.

    Args:
        mesh: any frame; open surfaces show their inside in slate blue. Without colours it is grey.
        up: unit, the mesh's frame.
        size: width and height, pixels.
    """
    picture = np.tile(_GROUND, (size * size, 1))
    if len(mesh.faces) == 0:
        return picture.reshape(size, size, 3).astype(np.uint8)
    subject = _subject(mesh, up, _REACH)
    direction = max(_directions(up), key=lambda towards: _outside_seen(subject, towards))
    return _picture(subject, direction, size, ground=True)


def dollhouse(mesh: Mesh, up: Float[np.ndarray, "3"], size: int) -> UInt8[np.ndarray, "size size 3"]:
    """Picture a room from above and outside; faces seen from behind (near walls, ceiling) are looked through."""
    subject = _subject(mesh, up, _ROOM_REACH)
    directions = [towards for towards in _directions(up) if towards @ up > np.sin(0.5)]
    direction = max(directions, key=lambda towards: _variety(subject, towards))
    return _picture(subject, direction, size, ground=False)


def turntable(
    mesh: Mesh, up: Float[np.ndarray, "3"], size: int, around: Mesh, paint: Paint | None = None, count: int = 3
) -> list[UInt8[np.ndarray, "size size 3"]]:
    """Picture a mesh from several sides as if `around` stood in its place: two meshes so pictured compare by pixel.

    Args:
        mesh: any frame.
        up: unit, the mesh's frame.
        size: width and height, pixels.
        around: decides where the camera stands and how far off; the first picture is from its best angle.
        paint: colours of points on the surface, in place of the vertices'.
        count: sides, evenly spaced.
    """
    framed = _subject(around, up, _REACH)
    first = max(_directions(up), key=lambda towards: _outside_seen(framed, towards))
    subject = replace(
        _subject(mesh, up, _REACH), centre=framed.centre, radius=framed.radius, reach=framed.reach, paint=paint
    )
    turns = np.arange(count) * 2 * np.pi / count
    return [_picture(subject, _turned(first, subject.up, turn), size, ground=True) for turn in turns]


def _turned(towards: Float64[np.ndarray, "3"], up: Float64[np.ndarray, "3"], angle: float) -> Float64[np.ndarray, "3"]:
    """A direction turned about the vertical (Rodrigues)."""
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
    """Unit vectors from the subject towards candidate eyes."""
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
    """Cast the rays of a square picture; `through` goes on behind faces seen from the back."""
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
    """Rays that met the back of a face; without faces met the last one's normal is looked at, and does not count."""
    return hits.found & (np.einsum("ij,ij->i", subject.face_normals[hits.triangle], rays) > 0)


def _outside_seen(subject: _Subject, towards: Float64[np.ndarray, "3"]) -> float:
    """Share of the picture that shows the outside, less what shows the inside."""
    sight = _look(subject, towards, _TRIAL_PX, through=False)
    return float((sight.hits.found & ~sight.inside).mean() - 2.0 * sight.inside.mean())


def _variety(subject: _Subject, towards: Float64[np.ndarray, "3"]) -> float:
    """Number of different faces in the picture: a view into a room beats one onto its walls."""
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
    """Colour times a soft key light, a fill light and the share of open sky."""
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
        # A stratum of the disc a pass, turned at random a pixel: little noise from few rays.
        angle = random.random(len(points)) * 2 * np.pi
        height = np.sqrt((step + random.random(len(points))) / _SKY_RAYS)
        ball = np.stack([np.cos(angle) * np.sqrt(1 - height**2), np.sin(angle) * np.sqrt(1 - height**2), height], 1)
        rays = _around(normals, ball)
        free += ~subject.scene.occluded(starts, rays, subject.reach)
    return free / _SKY_RAYS


def _around(normals: Float64[np.ndarray, "n 3"], local: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    """Vectors given in frames whose z axes are the normals (branchless basis, Duff et al. 2017)."""
    x, y, z = normals.T
    sign = np.where(z >= 0, 1.0, -1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    first = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], 1)
    second = np.stack([b, sign + y * y * a, -y], 1)
    return first * local[:, :1] + second * local[:, 1:2] + normals * local[:, 2:]


def _shadow(subject: _Subject, sight: _Sight, missed: np.ndarray) -> Float64[np.ndarray, "n"]:
    """How much of the sky the subject hides from the ground under each ray, 0 to 1."""
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
