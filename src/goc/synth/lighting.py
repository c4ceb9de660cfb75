"""Lighting of a room: area lights (window, ceiling lamp) with soft shadows, and reflections between all surfaces.

"Light" here is irradiance over pi, so that reflectance times light is radiance.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int

from goc.synth.surfaces import RoomSurfaces, ShadingPoints, appearance_at, triangle_centres
from goc.synth.vectors import dot, length, unit

_OFFSET = 1e-4
"""Metres by which rays start above their surface."""

_Rays = tuple[Int[np.ndarray, "_"], Int[np.ndarray, "_"]]


@dataclass(frozen=True, kw_only=True, eq=False)
class AreaLight:
    """A rectangular light that shines to one side."""

    centre: Float[np.ndarray, "3"]
    across: Float[np.ndarray, "3"]
    """Full width, as a vector."""
    along: Float[np.ndarray, "3"]
    """Full height, as a vector."""
    facing: Float[np.ndarray, "3"]
    """Unit normal of the side that shines."""
    radiance: Float[np.ndarray, "3"]

    @property
    def area(self) -> float:
        """Square metres."""
        return float(np.linalg.norm(np.cross(self.across, self.along)))


@dataclass(frozen=True, kw_only=True, eq=False)
class LitSurfaces:
    """Surfaces with their baked radiance: direct light and reflections between surfaces."""

    surfaces: RoomSurfaces
    lights: tuple[AreaLight, ...]
    radiance: Float32[np.ndarray, "t 3"]
    """Outgoing radiance of each triangle, all bounces included, its own emission excluded."""
    exposure: float
    """Factor that brings the room to a pleasant brightness."""


def bake(surfaces: RoomSurfaces, lights: tuple[AreaLight, ...], bounces: int = 3, samples: int = 8) -> LitSurfaces:
    """Compute the light at every triangle's middle, direct and by `bounces` reflections (radiosity by gathering)."""
    points = triangle_centres(surfaces)
    colour = appearance_at(surfaces, points).colour
    start = np.zeros(len(points), np.int64)
    direct = direct_light(surfaces, lights, points, start, samples)
    radiance = colour * direct
    rays = _gather_rays(surfaces, points, start, 2 * samples)
    for _ in range(bounces):
        radiance = colour * (direct + _mean_gathered(rays, radiance, len(points)))
    corners = surfaces.scene.vertices[surfaces.scene.faces]
    areas = length(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    walls = surfaces.owner == 0
    level = float((radiance.mean(-1) * areas)[walls].sum() / areas[walls].sum())
    return LitSurfaces(surfaces=surfaces, lights=lights, radiance=radiance, exposure=0.5 / max(level, 1e-9))


def light_on(
    lit: LitSurfaces, points: ShadingPoints, pattern: Int[np.ndarray, "n"], samples: int
) -> Float32[np.ndarray, "n 3"]:
    """Light at each spot: shadow rays to the lights, and rays that gather what other surfaces send out.

    Args:
        lit: the room.
        points: where to look.
        pattern: which run of the sample sequence each spot takes; neighbours take different ones and share results.
        samples: gathering rays a spot; half as many shadow rays for each light.
    """
    shadow_rays = max(1, samples // 2)
    rays = _gather_rays(lit.surfaces, points, pattern * samples, samples)
    reflected = _mean_gathered(rays, lit.radiance, len(points))
    return direct_light(lit.surfaces, lit.lights, points, pattern * shadow_rays, shadow_rays) + reflected


def direct_light(
    surfaces: RoomSurfaces,
    lights: tuple[AreaLight, ...],
    points: ShadingPoints,
    start: Int[np.ndarray, "n"],
    samples: int,
) -> Float32[np.ndarray, "n 3"]:
    """Light that arrives from area lights without reflection; stratified shadow rays."""
    total = np.zeros((len(points), 3), np.float32)
    origins = points.positions + _OFFSET * points.face_normals
    for number, light in enumerate(lights):
        arriving = np.zeros(len(points))
        for sample in range(samples):
            u, v = sequence(start + sample, number)
            target = light.centre + (u - 0.5)[:, None] * light.across + (v - 0.5)[:, None] * light.along
            path = target - origins
            square = dot(path, path)
            facing = np.minimum(dot(path, points.normals), 10 * dot(path, points.face_normals))
            geometry = np.maximum(facing, 0) * np.maximum(-path @ light.facing, 0) / (np.pi * square * square)
            reached = np.flatnonzero(geometry > 0)
            dark = surfaces.scene.occluded(origins[reached], path[reached], 1 - 1e-3)
            arriving[reached[~dark]] += geometry[reached[~dark]]
        total += (light.area / samples * arriving)[:, None] * light.radiance
    return total


def mirrored(
    lit: LitSurfaces, points: ShadingPoints, seen_from: Float[np.ndarray, "3"], strength: Float[np.ndarray, "n"]
) -> Float32[np.ndarray, "n 3"]:
    """Blurred reflections of the lights on glossy points, stronger at grazing angles (Schlick 1994)."""
    total = np.zeros((len(points), 3), np.float32)
    shiny = np.flatnonzero(strength > 0)
    view = unit(points.positions[shiny] - seen_from)
    normals = points.normals[shiny]
    cosine = -dot(view, normals)
    ray = view + 2 * cosine[:, None] * normals
    fresnel = strength[shiny] * (1 + 3 * (1 - np.clip(cosine, 0, 1)) ** 5)
    origins = points.positions[shiny] + 1e-3 * points.face_normals[shiny]
    for light in lit.lights:
        towards = -ray @ light.facing
        distance = (origins - light.centre) @ light.facing / np.maximum(towards, 1e-6)
        local = origins + distance[:, None] * ray - light.centre
        blur = 0.06 + 0.12 * np.clip(distance, 0, 6)
        inside = towards > 1e-3
        for side in (light.across, light.along):
            length = np.linalg.norm(side)
            over = np.abs(local @ side) / length - length / 2
            inside = inside * (0.5 - 0.5 * np.tanh(over / blur))
        bright = np.flatnonzero(inside > 0.01)
        dark = lit.surfaces.scene.occluded(origins[bright], ray[bright], distance[bright] * (1 - 1e-3))
        bright = bright[~dark]
        total[shiny[bright]] += (fresnel[bright] * inside[bright])[:, None] * light.radiance
    return total


def sequence(index: Int[np.ndarray, "n"], stream: int) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Points of a (0, 2)-sequence (the first two dimensions of Sobol), scrambled by stream: stratified at every 2^k."""
    scramble = np.array([0x9E3779B9, 0x85EBCA6B]) * (2 * stream + 1) & 0xFFFFFFFF
    first, second = np.zeros(len(index), np.uint32), np.zeros(len(index), np.uint32)
    direction = 1 << 31
    for bit in range(12):
        chosen = (index >> bit) & 1
        first ^= (chosen << (31 - bit)).astype(np.uint32)
        second ^= (chosen * direction).astype(np.uint32)
        direction ^= direction >> 1
    pair = np.stack([first, second]) ^ scramble.astype(np.uint32)[:, None]
    return pair[0] / 2.0**32, pair[1] / 2.0**32


def _gather_rays(
    surfaces: RoomSurfaces, points: ShadingPoints, start: Int[np.ndarray, "n"], samples: int
) -> list[_Rays]:
    """Cosine-distributed rays over each spot; for each of the samples, which points' rays hit which triangles."""
    first = unit(np.cross(points.normals, np.eye(3)[np.abs(points.normals).argmin(-1)]))
    second = np.cross(points.normals, first)
    origins = points.positions + _OFFSET * points.face_normals
    rays = []
    for sample in range(samples):
        u, v = sequence(start + sample, 7)
        radius, angle = np.sqrt(u), 2 * np.pi * v
        ray = (radius * np.cos(angle))[:, None] * first + (radius * np.sin(angle))[:, None] * second
        ray += np.sqrt(1 - u)[:, None] * points.normals
        hits = surfaces.scene.closest_hit(origins, ray)
        # A ray that meets the back of a triangle started inside something, where it is dark.
        front = dot(surfaces.face_normals[hits.triangle], ray) < 0
        chosen = np.flatnonzero(hits.found & front)
        rays.append((chosen, hits.triangle[chosen]))
    return rays


def _mean_gathered(rays: list[_Rays], radiance: Float32[np.ndarray, "t 3"], count: int) -> Float32[np.ndarray, "n 3"]:
    total = np.zeros((count, 3), np.float32)
    for points, triangles in rays:
        total[points] += radiance[triangles]
    return total / len(rays)
