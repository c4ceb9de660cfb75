"""One view of a lit room: colour with soft shadows, exact depth and ids at pixel centres."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int16, UInt8

from goc.files.colour import encode_srgb
from goc.geometry.rays import world_rays
from goc.scene import Camera
from goc.synth.lighting import LitSurfaces, light_on, mirrored
from goc.synth.surfaces import ShadingPoints, appearance_at, visible_points
from goc.synth.vectors import dot, length

# Order in which the 16 pixels of a 4x4 block take their share of the light samples (a Bayer matrix).
_PATTERN = np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]])
# Half weights at the rim: the window counts each of the 16 patterns once, so that their differences cancel.
_WINDOW = np.array([0.5, 1.0, 1.0, 1.0, 0.5])
# Antialiasing: the centre, and three samples round it (15°, 135°, 255°) that no row or column of pixels aligns with.
_OFFSETS = [(0.386, 0.104), (-0.283, 0.283), (-0.104, -0.386)]


@dataclass(frozen=True, kw_only=True, eq=False)
class RenderedView:
    """The rendered image of one camera, with exact depth, ids and normals."""

    colour: UInt8[np.ndarray, "h w 3"]
    """sRGB."""
    depth: Float[np.ndarray, "h w"]
    """z along the optical axis at pixel centres, metres, exact."""
    ids: Int16[np.ndarray, "h w"]
    """0 = room, 1… = objects."""
    normals: Float[np.ndarray, "h w 3"]
    """Normals of the triangles at pixel centres, camera axes, towards the camera, exact."""


def render_view(lit: LitSurfaces, camera: Camera, samples: int) -> RenderedView:
    """Cast rays through every pixel: one through its centre for depth, ids and light, that and three more for colour.

    Light is estimated with few rays a pixel that differ over blocks of 4x4 pixels, then averaged over neighbours on the
    same surface (interleaved sampling, Keller and Heidrich 2001): soft shadows without noise.

    Args:
        lit: the room; the camera stands inside.
        camera: the view to render.
        samples: gathering rays for each pixel, and half as many shadow rays for each light.
    """
    height, width = camera.height, camera.width
    points, depth = _seen(lit, camera, (0.0, 0.0))
    row, column = np.divmod(np.arange(height * width), width)
    light = light_on(lit, points, _PATTERN[row % 4, column % 4], samples)
    light = _smooth(light.reshape(height, width, 3), points, depth.reshape(height, width))
    total = _shaded(lit, camera, points, light.reshape(-1, 3))
    for offset in _OFFSETS:
        seen, _ = _seen(lit, camera, offset)
        total += _shaded(lit, camera, seen, _light_between(lit, light, points, seen, offset))
    return RenderedView(
        colour=encode_srgb(total / (1 + len(_OFFSETS))).reshape(height, width, 3),
        depth=depth.reshape(height, width),
        ids=lit.surfaces.owner[points.triangle].reshape(height, width),
        normals=(points.face_normals @ camera.world_from_cam[:3, :3].numpy()).reshape(height, width, 3),
    )


def _shaded(
    lit: LitSurfaces, camera: Camera, points: ShadingPoints, light: Float32[np.ndarray, "n 3"]
) -> Float32[np.ndarray, "n 3"]:
    """Linear colour in [0, 1] that the camera sees at each point under this light."""
    appearance = appearance_at(lit.surfaces, points)
    radiance = appearance.colour * light + appearance.glow / lit.exposure
    radiance += mirrored(lit, points, camera.position.double().numpy(), appearance.gloss)
    return _tone(lit.exposure * radiance)


def _seen(
    lit: LitSurfaces, camera: Camera, offset: tuple[float, float]
) -> tuple[ShadingPoints, Float[np.ndarray, "n"]]:
    """Points hit by rays through all pixels, `offset` pixels from their centres, and their depth z."""
    columns, rows = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    origins, rays = world_rays(camera, np.stack([columns, rows], -1).reshape(-1, 2) + offset)
    hits = lit.surfaces.scene.closest_hit(origins, rays)
    return visible_points(lit.surfaces, hits, origins + hits.t[:, None] * rays, rays), hits.t


def _smooth(
    light: Float32[np.ndarray, "h w 3"], points: ShadingPoints, depth: Float[np.ndarray, "h w"]
) -> Float32[np.ndarray, "h w 3"]:
    """Mean over 4x4 pixels (a 5x5 window with half-weight rim) that lie in the same plane and face the same way."""
    height, width = depth.shape
    positions = points.positions.reshape(height, width, 3).astype(np.float32)
    normals = points.normals.reshape(height, width, 3).astype(np.float32)
    level = np.einsum("hwc,hwc->hw", positions, normals)
    reach = 1.0 / (0.012 * depth).astype(np.float32)
    total, weights = np.zeros_like(light), np.zeros((height, width, 1), np.float32)
    for dy in range(-2, 3):
        for dx in range(-2, 3):
            here, there = _overlap(height, dy), _overlap(height, -dy)
            rows, columns = (here, there), (_overlap(width, dx), _overlap(width, -dx))
            a, b = (rows[0], columns[0]), (rows[1], columns[1])
            aligned = np.einsum("hwc,hwc->hw", normals[a], normals[b])
            off_plane = (np.einsum("hwc,hwc->hw", positions[b], normals[a]) - level[a]) * reach[a]
            alike = _fourth(_fourth(np.maximum(aligned, 0)) / (1 + off_plane * off_plane))
            weight = _WINDOW[dy + 2] * _WINDOW[dx + 2] * alike
            total[a] += weight[..., None] * light[b]
            weights[a] += weight[..., None]
    return total / weights


def _fourth(values: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
    square = values * values
    return square * square


def _overlap(size: int, shift: int) -> slice:
    """Indices i of a row of `size` for which i + shift lies in the row too."""
    return slice(max(0, -shift), size - max(0, shift))


def _light_between(
    lit: LitSurfaces,
    light: Float32[np.ndarray, "h w 3"],
    centres: ShadingPoints,
    seen: ShadingPoints,
    offset: tuple[float, float],
) -> Float32[np.ndarray, "n 3"]:
    """Light at points seen off pixel centres: that of the own or a neighbouring centre on the same surface.

    Where the edge of something thin passes between centres there is none, and light is computed at the spot itself.
    """
    height, width = light.shape[:2]
    result = light.reshape(-1, 3).copy()
    dx, dy = (1 if shift > 0 else -1 for shift in offset)
    lost = np.arange(height * width)
    for row_step, column_step in ((0, 0), (0, dx), (dy, 0), (dy, dx)):
        row, column = np.divmod(lost, width)
        other = np.clip(row + row_step, 0, height - 1) * width + np.clip(column + column_step, 0, width - 1)
        normals = seen.normals[lost]
        apart = seen.positions[lost] - centres.positions[other]
        off_plane = np.abs(dot(apart, normals))
        same = (off_plane < 0.15 * length(apart) + 0.002) & (dot(normals, centres.normals[other]) > 0.8)
        result[lost[same]] = light.reshape(-1, 3)[other[same]]
        lost = lost[~same]
    if len(lost):
        result[lost] = light_on(lit, seen[lost], np.zeros(len(lost), np.int64), 16)
    return result


def _tone(radiance: Float32[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n 3"]:
    """Bring radiance into [0, 1]: Reinhard's curve with white at 2.2 (2002)."""
    return np.minimum(radiance * (1 + radiance / 2.2**2) / (1 + radiance), 1.0)
