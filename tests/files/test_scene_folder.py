"""A scene is what its folder says: it comes back whole, and a folder that is not whole is refused in one line."""

import json
import re
from dataclasses import fields, replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from assets import box_mesh, box_scene
from cameras import pinhole
from fuzz import assert_only_file_errors
from goc.errors import FileError
from goc.files import (
    object_files,
    object_ids,
    read_evidence,
    read_meshes,
    read_scene,
    read_splats,
    write_evidence,
    write_json,
    write_scene,
    write_tensors,
)
from goc.files.layout import run_files
from goc.scene import (
    Completed,
    Contact,
    EvidenceGrid,
    FlaggedMesh,
    Gaussians,
    HalfSpace,
    Mesh,
    Scene,
    SceneObject,
    World,
)

FILES = {
    "scene.json",
    "scene/mesh.ply",
    "scene/splats.ply",
    "scene/labels.safetensors",
    "objects/1/observed.ply",
    "objects/1/mesh.ply",
    "objects/1/splats.ply",
    "objects/1/evidence.safetensors",
}


def random_mesh(random, colours):
    """Triangles without meaning; every vertex has finite numbers."""
    count = int(random.integers(3, 9))
    return Mesh(
        vertices=random.normal(size=(count, 3)).astype(np.float32),
        faces=random.integers(0, count, (int(random.integers(1, 9)), 3)).astype(np.int32),
        colours=random.integers(0, 256, (count, 3)).astype(np.uint8) if colours else None,
    )


def flagged(random, colours):
    mesh = random_mesh(random, colours)
    return FlaggedMesh(mesh=mesh, observed=random.random(len(mesh.vertices)) < 0.5)


def random_grid(random):
    shape = tuple(int(n) for n in random.integers(1, 6, 3))
    state = random.integers(0, 3, shape).astype(np.uint8)
    sdf = np.where(state == 2, random.normal(size=shape), 0).astype(np.float32)
    return EvidenceGrid(origin=random.normal(size=3), voxel=float(random.random()) + 1e-3, state=state, sdf=sdf)


def random_camera(random):
    pose = np.eye(4)
    pose[:3] = random.normal(size=(3, 4))
    size = int(random.integers(1, 99)), int(random.integers(1, 99))
    return pinhole(random.random(2) + 50, size, random.random(2) + 30, pose)


def random_scene(seed, parts):
    """A scene of one object for each set of parts that it is to have."""
    random = np.random.default_rng(seed)
    count, ids = int(random.integers(0, 40)), sorted(random.choice(999, len(parts), replace=False) + 1)
    labels = torch.from_numpy(random.choice([-1, 0, *ids], count).astype(np.int16))
    splats = Gaussians(
        means=torch.from_numpy(random.normal(size=(count, 3))).float(),
        quats=torch.eye(4)[random.integers(0, 4, count)],
        log_scales=torch.from_numpy(random.normal(size=(count, 3))).float(),
        opacity_logits=torch.from_numpy(random.normal(size=count)).float(),
        sh=torch.from_numpy(random.normal(size=(count, 4, 3))).float(),
        identity=torch.from_numpy(random.normal(size=(count, 3))).float() if "identity" in parts[0] else None,
    )
    up = random.normal(size=3)
    objects = []
    for id, own in zip(ids, parts, strict=True):
        pose = np.eye(4)
        pose[:3, 3] = random.normal(size=3)
        objects.append(
            SceneObject(
                id=int(id),
                name=f"Stuhl № {id}",
                world_from_object=pose,
                splats=splats[labels == int(id)] if "splats" in own else None,
                observed=flagged(random, "colours" in own) if "observed" in own else None,
                solid=flagged(random, "colours" in own) if "solid" in own else None,
                evidence=random_grid(random) if "evidence" in own else None,
                contact=random_contact(random) if "contact" in own else None,
                walls=tuple(random_plane(random) for _ in range(2)) if "contact" in own else (),
                completed=random_completed(random) if "solid" in own else None,
            )
        )
    return Scene(
        splats=splats,
        labels=labels,
        mesh=random_mesh(random, "colours" in parts[0]),
        objects=tuple(objects),
        cameras={f"images/{n}.png": random_camera(random) for n in range(int(random.integers(0, 4)))},
        world=World(
            up=up / np.linalg.norm(up),
            floor=float(random.normal()),
            confidence=float(random.random()),
            units_per_metre=float(10 ** random.uniform(-3, 3)),
            metric=bool(random.random() < 0.5),
        ),
        metrics={"psnr_db": float(random.normal()), "nobody knows": float("nan")},
        settings={"reconstruct": {"seed": 3, "rates": [0.1, 0.2]}, "complete": {"weights": None}},
    )


def random_plane(random):
    normal = random.normal(size=3)
    return HalfSpace(normal=normal / np.linalg.norm(normal), offset=float(random.normal()))


def random_completed(random):
    error = float(random.random()) if random.random() < 0.5 else None
    return Completed(method="convex hull", expected_error=error, trusted=bool(random.random() < 0.5))


def random_contact(random):
    return Contact(on=(0, 2), plane=random_plane(random), confidence=float(random.random()))


def assert_same(one, other, path="scene"):
    """Equal to the last bit, whatever they are made of."""
    assert type(one) is type(other), path
    if isinstance(one, torch.Tensor):
        assert one.dtype == other.dtype and torch.equal(one, other), path
    elif isinstance(one, np.ndarray):
        assert one.dtype == other.dtype and np.array_equal(one, other), path
    elif isinstance(one, tuple):
        assert len(one) == len(other), path
        for number, (a, b) in enumerate(zip(one, other, strict=True)):
            assert_same(a, b, f"{path}[{number}]")
    elif isinstance(one, dict):
        assert list(one) == list(other), path
        for key in one:
            assert_same(one[key], other[key], f"{path}[{key}]")
    elif hasattr(one, "__dataclass_fields__"):
        for item in fields(one):
            assert_same(getattr(one, item.name), getattr(other, item.name), f"{path}.{item.name}")
    else:
        assert one == other or (one != one and other != other), path


PARTS = st.sets(st.sampled_from(["splats", "observed", "solid", "evidence", "contact", "colours", "identity"]))


@given(st.integers(0, 10_000), st.lists(PARTS, min_size=1, max_size=3))
@settings(max_examples=40)
def test_a_scene_comes_back_whole(tmp_path_factory, seed, parts):
    before, folder = random_scene(seed, parts), tmp_path_factory.mktemp("scene")
    write_scene(folder, before)
    after = read_scene(folder)
    assert_same(after, before)
    for item in after.objects:
        if item.splats is not None:
            assert_same(read_splats(object_files(folder, item.id).splats), replace(item.splats, identity=None))


def test_the_same_scene_gives_the_same_bytes(tmp_path):
    for name in "ab":
        write_scene(tmp_path / name, box_scene())
    for path in run_files(tmp_path / "a"):
        assert (tmp_path / "a" / path).read_bytes() == (tmp_path / "b" / path).read_bytes(), path


@pytest.fixture(scope="module")
def closed_scene():
    scene = box_scene()
    first = scene.objects[0]
    solid = FlaggedMesh(mesh=box_mesh(np.array([[0.0, 0, 0], [1, 1, 1]])), observed=np.arange(8) < 3)
    return replace(scene, objects=(replace(first, solid=solid), scene.objects[1]))


@pytest.fixture
def folder(tmp_path, closed_scene):
    write_scene(tmp_path, closed_scene)
    return tmp_path


def test_every_file_of_a_run_has_its_place(folder):
    second = {f"objects/2/{name}" for name in ("observed.ply", "splats.ply", "evidence.safetensors")}
    assert {str(path) for path in run_files(folder)} == FILES | second
    assert {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()} == FILES | second
    (folder / "objects/x").mkdir()
    (folder / "objects/03").mkdir()
    assert object_ids(folder) == [1, 2] and object_ids(folder / "objects") == []


def test_meshes_are_read_without_the_rest(folder, closed_scene):
    for path in ("scene/splats.ply", "scene/labels.safetensors", "objects/1/evidence.safetensors"):
        (folder / path).unlink()
    first, second = closed_scene.objects
    best = read_meshes(folder, ("solid", "observed"))
    assert {id: kind for id, (kind, _) in best.items()} == {1: "solid", 2: "observed"}
    assert_same(best[1][1], first.solid.mesh)
    assert list(read_meshes(folder, ("solid",))) == [1]
    assert_same(read_meshes(folder, ("observed",))[2][1], second.observed.mesh)


def test_a_folder_without_scene_json_has_the_objects_that_are_there(folder):
    (folder / "scene.json").unlink()
    (folder / "objects/2/observed.ply").unlink()
    assert {id: kind for id, (kind, _) in read_meshes(folder, ("observed", "solid")).items()} == {1: "observed"}


def test_a_mesh_that_is_listed_and_lost_is_not_passed_over(folder):
    (folder / "objects/1/mesh.ply").unlink()
    with pytest.raises(FileError, match=r"objects/1/mesh\.ply: not found"):
        read_meshes(folder, ("solid", "observed"))


@pytest.mark.parametrize("name", sorted(FILES))
def test_a_file_that_is_missing_is_named(folder, name):
    (folder / name).unlink()
    with pytest.raises(FileError, match=rf"{re.escape(name)}: not found"):
        read_scene(folder)


@pytest.mark.parametrize("name", sorted(FILES - {"objects/1/splats.ply"}))
@pytest.mark.parametrize("share", [0.0, 0.5, 0.95])
def test_a_file_that_is_cut_off_is_named(folder, name, share):
    data = (folder / name).read_bytes()
    (folder / name).write_bytes(data[: int(share * len(data))])
    with pytest.raises(FileError, match=re.escape(name)) as refused:
        read_scene(folder)
    assert "\n" not in str(refused.value)


def changed(folder, **entries):
    """Put other content into scene.json."""
    path = folder / "scene.json"
    write_json(path, json.loads(path.read_text()) | entries)


def test_another_schema_is_refused_by_its_number(folder):
    changed(folder, schema=2, news="from the future")
    with pytest.raises(FileError, match=r"scene\.json: has schema 2, and this goc reads 1\. Read it with a newer goc"):
        read_scene(folder)
    changed(folder, schema=0)
    with pytest.raises(FileError, match=r"has schema 0 of an older goc, and this one reads 1\. Carve again"):
        read_scene(folder)


def broken(entry, **changes):
    return [entry[0] | changes, *entry[1:]]


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda d: {"surprise": 1}, "surprise"),
        (lambda d: {"objects": d["objects"][::-1]}, r"the ids of its 2 objects do not ascend"),
        (lambda d: {"objects": broken(d["objects"], id=0)}, r"objects\[0\]\.id"),
        (lambda d: {"objects": broken(d["objects"], id=3)[::-1]}, r"objects/3/splats\.ply: not found, but scene\.json"),
        (lambda d: {"objects": broken(d["objects"], splats=False, id=1) + broken(d["objects"], id=9)}, "do not ascend"),
        (lambda d: {"cameras": d["cameras"] * 2}, r"1 names belong to several cameras \(first: images/1\.png\)"),
        (lambda d: {"cameras": broken(d["cameras"], width=0)}, r"cameras\[0\]\.width"),
        (lambda d: {"world": d["world"] | {"up": [0, 0, 2]}}, r"world\.up \(0\.0, 0\.0, 2\.0\) is not of length 1"),
        (lambda d: {"world": d["world"] | {"floor": 0.5}}, r"world\.level_from_world is not what up, floor"),
        (lambda d: {"world": d["world"] | {"units_per_metre": 0}}, r"units_per_metre"),
    ],
)
def test_content_that_contradicts_itself_is_refused(folder, change, text):
    changed(folder, **change(json.loads((folder / "scene.json").read_text())))
    with pytest.raises(FileError, match=text):
        read_scene(folder)


@pytest.mark.parametrize(
    ("tensors", "text"),
    [
        ({"labels": torch.zeros(29, dtype=torch.int16)}, r"29 labels for 30 splats in scene/splats\.ply"),
        ({"labels": torch.zeros(30, dtype=torch.int32)}, r"holds no labels of splats"),
        ({"other": torch.zeros(30, dtype=torch.int16)}, r"holds no labels of splats"),
        ({"labels": torch.full((30,), -2, dtype=torch.int16)}, r"30 labels are below -1"),
        ({"labels": torch.zeros(30, dtype=torch.int16), "identity": torch.zeros(3, 4)}, r"30 labels for 30 splats"),
    ],
)
def test_labels_of_other_splats_are_refused(folder, tensors, text):
    write_tensors(folder / "scene/labels.safetensors", tensors)
    with pytest.raises(FileError, match=text):
        read_scene(folder)


def test_a_large_grid_takes_little_room(tmp_path):
    axes = np.meshgrid(*[np.arange(96)] * 3, indexing="ij")
    sdf = (np.linalg.norm(np.stack(axes, -1) - 48.0, axis=-1) - 30).astype(np.float32)
    band = np.abs(sdf) < 3
    state = np.where(band, 2, np.where(sdf > 0, 1, 0)).astype(np.uint8)
    grid = EvidenceGrid(origin=np.zeros(3), voxel=0.01, state=state, sdf=np.where(band, sdf, 0))
    write_evidence(tmp_path / "e.safetensors", grid)
    assert (tmp_path / "e.safetensors").stat().st_size < (4 * band.sum()) * 1.2
    assert_same(read_evidence(tmp_path / "e.safetensors"), grid)


def test_damaged_grids_give_one_kind_of_error(tmp_path):
    write_evidence(tmp_path / "e.safetensors", random_grid(np.random.default_rng(5)))
    assert_only_file_errors(read_evidence, tmp_path / "e.safetensors")


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("state", None, "tensor state is missing"),
        ("sdf", torch.zeros(3, 3), "tensor sdf is missing or of another kind"),
        ("voxel", torch.tensor(0.0, dtype=torch.float64), "its origin or voxel is no place or length"),
        ("shape", torch.tensor([2, 2]), r"\(2, 2\) is no shape of a grid"),
        ("shape", torch.tensor([2, 2, 3]), "it does not hold the states of 12 voxels"),
        ("shape", torch.tensor([1, 2, 2]), "it does not hold the states of 4 voxels"),
        ("state", torch.zeros(9, dtype=torch.uint8), "its states cannot be unpacked"),
        ("sdf", torch.zeros(1), "1 distances for 2 surface voxels"),
    ],
)
def test_grids_that_contradict_themselves_are_refused(tmp_path, name, value, text):
    from goc.files import read_tensors

    path = tmp_path / "e.safetensors"
    write_evidence(path, box_scene().objects[0].evidence)
    tensors = read_tensors(path)[0] | {name: value}
    write_tensors(path, {key: tensor for key, tensor in tensors.items() if tensor is not None})
    with pytest.raises(FileError, match=text):
        read_evidence(path)
