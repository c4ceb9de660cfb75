import numpy as np
import pytest
import torch

from fuzz import assert_only_file_errors
from goc.errors import FileError
from goc.files import read_ply, read_splats, write_ply, write_splats
from goc.scene import Gaussians


def splats(count=5, degree=3, seed=0):
    generator = torch.Generator().manual_seed(seed)

    def normal(*shape):
        return torch.randn(shape, generator=generator)

    return Gaussians(
        means=normal(count, 3),
        quats=torch.nn.functional.normalize(normal(count, 4), dim=-1),
        log_scales=normal(count, 3),
        opacity_logits=normal(count),
        sh=normal(count, (degree + 1) ** 2, 3),
    )


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_splats_come_back(tmp_path, degree):
    before = splats(degree=degree)
    write_splats(tmp_path / "s.ply", before)
    after = read_splats(tmp_path / "s.ply")
    assert torch.equal(after.means, before.means)
    assert torch.equal(after.sh, before.sh)
    assert torch.equal(after.log_scales, before.log_scales)
    assert torch.equal(after.opacity_logits, before.opacity_logits)
    torch.testing.assert_close(after.quats, before.quats, rtol=0, atol=1e-7)  # normalised once more


def test_the_layout_is_that_of_3d_gaussian_splatting(tmp_path):
    """Property order of the reference files, and f_rest channel by channel: red's 15 coefficients come first."""
    before = splats(degree=3)
    write_splats(tmp_path / "s.ply", before)
    vertex = read_ply(tmp_path / "s.ply")["vertex"]
    names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", *(f"f_rest_{i}" for i in range(45))]
    names += ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    assert list(vertex) == names
    assert all(column.dtype == np.float32 for column in vertex.values())
    np.testing.assert_array_equal(vertex["f_dc_1"], before.sh[:, 0, 1])
    for channel in range(3):
        for coefficient in range(1, 16):
            stored = vertex[f"f_rest_{channel * 15 + coefficient - 1}"]
            np.testing.assert_array_equal(stored, before.sh[:, coefficient, channel])


def test_rotations_of_any_length_are_stored_with_length_one(tmp_path):
    before = splats()
    long = Gaussians(**{**vars(before), "quats": before.quats * 7})
    write_splats(tmp_path / "s.ply", long)
    torch.testing.assert_close(read_splats(tmp_path / "s.ply").quats, before.quats)


def test_splats_that_nothing_can_draw_are_neither_written_nor_read(tmp_path):
    good = splats()
    bad = Gaussians(**{**vars(good), "log_scales": torch.full((5, 3), torch.nan)})
    with pytest.raises(FileError, match=r"s\.ply: 5 of 5 splats are not finite \(first: 0\)"):
        write_splats(tmp_path / "s.ply", bad)
    assert not (tmp_path / "s.ply").exists()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"opacity": None}, r"1 properties of a splat file are missing \(first: opacity\)"),
        ({"f_rest_0": None}, "44 f_rest properties belong to no degree"),
        ({"x": np.array([np.inf], np.float32)}, r"1 of 1 splats are not finite"),
        ({f"rot_{i}": np.zeros(1, np.float32) for i in range(4)}, "1 splats have a zero rotation"),
    ],
)
def test_files_that_hold_no_splats_are_refused(tmp_path, change, message):
    write_splats(tmp_path / "s.ply", splats(count=1))
    vertex = read_ply(tmp_path / "s.ply")["vertex"] | change
    write_ply(tmp_path / "s.ply", {"vertex": {name: column for name, column in vertex.items() if column is not None}})
    with pytest.raises(FileError, match=message):
        read_splats(tmp_path / "s.ply")


def test_damaged_splats_raise_only_file_errors(tmp_path):
    write_splats(tmp_path / "good.ply", splats(degree=1))
    assert_only_file_errors(read_splats, tmp_path / "good.ply", count=600)
