"""What is written is what is read, bit by bit where the format allows it, over sizes, ranges and optional parts."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import torch

from goc.files import (
    read_depth,
    read_ids,
    read_image,
    read_json,
    read_mesh,
    read_normals,
    read_observed_mesh,
    read_ply,
    read_points,
    read_scan,
    read_splats,
    read_tensors,
    write_depth,
    write_ids,
    write_image,
    write_json,
    write_mesh,
    write_normals,
    write_ply,
    write_png,
    write_points,
    write_splats,
    write_tensors,
)
from goc.files.colour import decode_srgb, encode_srgb
from goc.scene import UNLABELLED, Gaussians, Mesh, PointCloud
from laws import SCALES, SHEETS, SOLIDS, over, scaled

MESHES = {**SOLIDS, **SHEETS}
SIZES = {"one pixel": (1, 1), "row": (1, 37), "column": (29, 1), "odd": (13, 7), "wide": (9, 130)}
COUNTS = {"none": 0, "one": 1, "some": 37}


def random(seed=0) -> np.random.Generator:
    return np.random.default_rng(seed)


@over(mesh=MESHES, scale=SCALES, coloured={"plain": False, "coloured": True})
def test_meshes(tmp_path, mesh, scale, coloured):
    colours = random().integers(0, 256, (len(mesh.vertices), 3), dtype=np.uint8) if coloured else None
    before = Mesh(vertices=scaled(mesh, scale).vertices, faces=mesh.faces, colours=colours)
    observed = random(1).random(len(mesh.vertices)) < 0.5
    write_mesh(tmp_path / "m.ply", before, observed)
    after, flags = read_observed_mesh(tmp_path / "m.ply")
    np.testing.assert_array_equal(after.vertices, before.vertices)
    np.testing.assert_array_equal(after.faces, before.faces)
    np.testing.assert_array_equal(flags, observed)
    assert (after.colours is None) if colours is None else np.array_equal(after.colours, colours)
    again, scan = read_mesh(tmp_path / "m.ply"), read_scan(tmp_path / "m.ply").surface
    assert isinstance(scan, Mesh) and np.array_equal(again.vertices, scan.vertices)


@over(count={"one": 1, "some": 37}, scale=SCALES, normals={"bare": False, "with normals": True})
def test_points(tmp_path, count, scale, normals):
    before = PointCloud(
        positions=(scale * random().normal(size=(count, 3))).astype(np.float32),
        colours=random(1).integers(0, 256, (count, 3), dtype=np.uint8),
        normals=random(2).normal(size=(count, 3)).astype(np.float32) if normals else None,
    )
    write_points(tmp_path / "p.ply", before)
    for after in (read_points(tmp_path / "p.ply"), read_scan(tmp_path / "p.ply").surface):
        assert isinstance(after, PointCloud)
        np.testing.assert_array_equal(after.positions, before.positions)
        np.testing.assert_array_equal(after.colours, before.colours)
        assert (after.normals is None) == (not normals)
        if normals:
            np.testing.assert_array_equal(after.normals, before.normals)


@over(count=COUNTS, scale=SCALES)
@pytest.mark.parametrize("degree", range(4))
def test_splats(tmp_path, count, scale, degree):
    def normal(*shape: int) -> torch.Tensor:
        return torch.from_numpy(random(sum(shape)).normal(size=shape)).float()

    before = Gaussians(
        means=scale * normal(count, 3),
        quats=normal(count, 4),
        log_scales=normal(count, 3) + np.log(scale),
        opacity_logits=5 * normal(count),
        sh=normal(count, (degree + 1) ** 2, 3),
    )
    write_splats(tmp_path / "s.ply", before)
    after = read_splats(tmp_path / "s.ply")
    for name in ("means", "log_scales", "opacity_logits", "sh"):
        assert torch.equal(getattr(after, name), getattr(before, name)), name
    torch.testing.assert_close(after.quats, torch.nn.functional.normalize(before.quats, dim=-1), rtol=0, atol=2e-7)
    write_splats(tmp_path / "t.ply", after)  # written twice, the second time nothing changes but roundings of the norm
    torch.testing.assert_close(read_splats(tmp_path / "t.ply").quats, after.quats, rtol=0, atol=2e-7)


TENSORS = {
    "float32": torch.randn(3, 4),
    "float64": torch.randn(2, dtype=torch.float64),
    "half": torch.randn(5).half(),
    "whole numbers": torch.arange(-3, 4),
    "bytes": torch.arange(7, dtype=torch.uint8),
    "flags": torch.tensor([True, False]),
    "scalar": torch.tensor(2.5),
    "empty": torch.zeros(0, 3),
    "turned": torch.arange(6.0).reshape(2, 3).T,
    "every other": torch.arange(10)[::2],
    "no numbers": torch.tensor([float("nan"), float("inf"), -0.0]),
}


@over(tensor=TENSORS)
def test_tensors(tmp_path, tensor):
    write_tensors(tmp_path / "t", {"a": tensor, "b": torch.zeros(1)}, {"note": "ü, \n, {}"})
    read, notes = read_tensors(tmp_path / "t")
    assert read["a"].dtype == tensor.dtype and read["a"].shape == tensor.shape and notes == {"note": "ü, \n, {}"}
    same = read["a"].numpy().tobytes() == tensor.contiguous().numpy().tobytes()
    assert same and read["a"].is_contiguous()


@over(size=SIZES)
@pytest.mark.parametrize("reach", [0.05, 4.0, 60.0])
def test_depth_to_half_a_millimetre(tmp_path, size, reach):
    depth = random(3).uniform(0.001, reach, size)
    depth.reshape(-1)[::5] = np.nan
    write_depth(tmp_path / "d.png", depth)
    read = read_depth(tmp_path / "d.png")
    np.testing.assert_array_equal(np.isnan(read), np.isnan(depth))
    assert np.nanmax(np.abs(read - depth), initial=0.0) <= 0.00051
    write_depth(tmp_path / "again.png", read.astype(np.float64))
    assert (tmp_path / "again.png").read_bytes() == (tmp_path / "d.png").read_bytes()


@over(size=SIZES)
@pytest.mark.parametrize("most", [0, 254, 255, 32767])
def test_ids(tmp_path, size, most):
    ids = random(4).integers(-1, most + 1, size).astype(np.int16)
    ids.reshape(-1)[0] = most
    ids.reshape(-1)[-1] = UNLABELLED if ids.size > 1 else most
    write_ids(tmp_path / "i.png", ids)
    np.testing.assert_array_equal(read_ids(tmp_path / "i.png"), ids)


@over(size=SIZES)
def test_normals_to_half_a_degree(tmp_path, size):
    normals = random(5).normal(size=(*size, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    normals.reshape(-1, 3)[1::4] = np.nan
    write_normals(tmp_path / "n.png", normals)
    read = read_normals(tmp_path / "n.png")
    known = np.isfinite(normals).all(-1)
    np.testing.assert_array_equal(np.isfinite(read).all(-1), known)
    cosines = (read[known] * normals[known]).sum(-1)
    assert cosines.size == 0 or np.degrees(np.arccos(np.clip(cosines, -1, 1))).max() < 0.5


@over(size=SIZES)
def test_colour_images(tmp_path, size):
    pixels = random(6).integers(0, 256, (*size, 3), dtype=np.uint8)
    write_png(tmp_path / "a.png", pixels)
    write_image(tmp_path / "b.png", pixels)
    np.testing.assert_array_equal(read_image(tmp_path / "a.png"), pixels)
    np.testing.assert_array_equal(read_image(tmp_path / "b.png"), pixels)
    grey = np.ascontiguousarray(pixels[..., 0])
    write_png(tmp_path / "g.png", grey)
    np.testing.assert_array_equal(read_image(tmp_path / "g.png"), np.repeat(grey[..., None], 3, 2))
    write_image(tmp_path / "c.jpg", np.full((*size, 3), 90, np.uint8))
    assert np.abs(read_image(tmp_path / "c.jpg").astype(int) - 90).max() <= 1


def test_every_byte_of_srgb_survives_linear_light():
    stored = np.arange(256, dtype=np.uint8)
    light = decode_srgb(stored)
    np.testing.assert_array_equal(encode_srgb(light), stored)
    assert (np.diff(light) > 0).all() and light[0] == 0.0 and light[-1] == 1.0
    assert encode_srgb(np.array([-1.0, 2.0])).tolist() == [0, 255]


@pytest.mark.parametrize("kind", ["i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"])
@over(count=COUNTS)
def test_columns_of_any_type(tmp_path, kind, count):
    dtype = np.dtype(kind)
    if dtype.kind == "f":
        column = (random(7).normal(size=count) * 1e3).astype(dtype)
    else:
        info = np.iinfo(dtype)
        column = random(7).integers(info.min, info.max, count, dtype=dtype, endpoint=True)
    lists = np.stack([column, column], 1) if count else np.zeros((0, 2), dtype)
    write_ply(tmp_path / "c.ply", {"thing": {"value": column, "pair": lists}, "other": {"n": np.arange(3, dtype="i4")}})
    read = read_ply(tmp_path / "c.ply")
    np.testing.assert_array_equal(read["thing"]["value"], column)
    assert read["thing"]["value"].dtype == dtype and read["other"]["n"].tolist() == [0, 1, 2]
    np.testing.assert_array_equal(read["thing"]["pair"].values.reshape(-1, 2), lists)
    assert (read["thing"]["pair"].counts == 2).all()


@dataclass(frozen=True)
class Note:
    """A nested document."""

    name: str
    values: tuple[float, ...]
    parts: dict[str, int]
    where: str | None = None


@pytest.mark.parametrize(
    "note",
    [
        Note("", (), {}),
        Note("ein Stück “Text”\n\t\\", (0.1, -0.0, 1e300, 5e-324), {"": 0, "ß": -(2**53)}, "there"),
        Note("many", tuple(np.random.default_rng(8).normal(size=50).tolist()), {str(i): i for i in range(99)}),
    ],
)
def test_documents(tmp_path, note):
    write_json(tmp_path / "n.json", note)
    assert read_json(tmp_path / "n.json", Note) == note
    (tmp_path / "marked.json").write_bytes(b"\xef\xbb\xbf" + (tmp_path / "n.json").read_bytes())
    assert read_json(tmp_path / "marked.json", Note) == note


@pytest.mark.parametrize(
    ("value", "read"),
    [
        (np.float32(0.5), 0.5),
        (np.int64(7), 7),
        (torch.tensor(3), 3),
        (Path("a/b"), "a/b"),
        (float("nan"), None),
        (float("-inf"), None),
    ],
)
def test_scalars_of_other_libraries_become_plain_ones(tmp_path, value, read):
    write_json(tmp_path / "v.json", {"v": value})
    assert read_json(tmp_path / "v.json", dict[str, float | str | None]) == {"v": read}


def test_what_has_no_json_form_is_named(tmp_path):
    with pytest.raises(NotImplementedError, match="object has no JSON form"):
        write_json(tmp_path / "v.json", {"v": object()})
