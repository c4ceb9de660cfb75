from dataclasses import replace

import numpy as np
import pytest
import torch

from assets import box_mesh, box_scene, inside_out
from captures import write_nerfstudio
from goc.capture import load_capture
from goc.errors import ConfigError
from goc.export import ExportConfig
from goc.report import draw_overview
from goc.report.canvas import Canvas, plain
from goc.report.overview import _measures, choose_views
from goc.report.palette import colour_of_id, colours_of_depth, colours_of_ids
from goc.report.portraits import dollhouse, portrait
from goc.runs import RunRecord
from goc.scene import Mesh

UP = np.array([0.0, 0.0, 1.0])
CUBE = np.array([[0.0, 0, 0], [1, 1, 1]])
SLATE = np.array([118, 128, 148]) / 148


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    return load_capture(write_nerfstudio(tmp_path_factory.mktemp("capture"), views=6))


def ground_share(picture):
    return (np.abs(picture.astype(int) - [241, 241, 238]).max(-1) <= 2).mean()


def test_a_portrait_shows_its_colour_in_the_middle_and_ground_around():
    picture = portrait(box_mesh(CUBE, (220, 30, 30)), UP, 64)
    red, green, blue = picture[32, 32].astype(int)
    assert red > 2 * green and red > 2 * blue
    assert 0.2 < ground_share(picture) < 0.9
    assert (picture[0, 0] > 225).all()


def test_an_open_surface_is_shown_from_outside_where_it_can_be():
    cube = box_mesh(CUBE, (220, 30, 30))
    normals_x = np.cross(*(cube.vertices[cube.faces[:, k]] - cube.vertices[cube.faces[:, 0]] for k in (1, 2)))[:, 0]
    half = replace(cube, faces=cube.faces[normals_x <= 0])  # the side towards +x is missing
    picture = portrait(half, UP, 64).reshape(-1, 3).astype(float)
    slate = np.abs(picture / picture.max(1, keepdims=True) - SLATE).max(1) < 0.03
    assert slate.mean() < 0.02


def test_pictures_do_not_depend_on_the_frame():
    """A turned and shifted object, with its up turned along, looks the same up to the choice of its angle."""
    turn = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    cube = box_mesh(CUBE * [1, 1, 2])
    moved = replace(cube, vertices=(cube.vertices @ turn.T + 5.0).astype(np.float32))
    first, second = portrait(cube, UP, 48), portrait(moved, turn @ UP, 48)
    assert abs(ground_share(first) - ground_share(second)) < 0.1


def test_a_mesh_without_faces_or_colours_is_still_pictured():
    empty = Mesh(vertices=np.zeros((0, 3), np.float32), faces=np.zeros((0, 3), np.int32))
    assert ground_share(portrait(empty, UP, 16)) == 1.0
    assert ground_share(portrait(replace(box_mesh(CUBE), colours=None), UP, 16)) < 0.9


def test_a_room_is_looked_into():
    room = inside_out(box_mesh(np.array([[0.0, 0, 0], [4, 3, 2.5]]), (40, 90, 220)))
    red, _, blue = dollhouse(room, UP, 48)[26, 24].astype(int)
    assert blue > 1.5 * red


def test_ids_have_colours_of_their_own():
    colours = np.array([colour_of_id(number) for number in range(-1, 41)], int)
    apart = np.abs(colours[:, None] - colours[None]).sum(-1) + 1000 * np.eye(len(colours), dtype=int)
    assert apart.min() > 8
    assert np.abs(np.diff(colours[2:], axis=0)).sum(-1).min() > 60
    image = colours_of_ids(np.array([[0, 7], [-1, 7]], np.int16))
    assert tuple(image[0, 1]) == colour_of_id(7) == tuple(image[1, 1])
    assert tuple(image[1, 0]) == colour_of_id(-1)


def test_depth_runs_from_bright_to_dark_and_holes_are_grey():
    ramp = colours_of_depth(np.array([[0.5, 1.0, 2.0, 3.0, 9.0, np.nan]]), 1.0, 3.0)[0].astype(int)
    brightness = ramp.sum(1)
    assert brightness[0] == brightness[1] > brightness[2] > brightness[3] == brightness[4]
    assert tuple(ramp[5]) == colour_of_id(-1)


def test_words_are_cut_to_their_width_and_spelt_with_the_letters_there_are():
    assert plain("Café Stuhl №7 · 椅") == "Cafe Stuhl No7 · ?"
    canvas = Canvas(300, 60)
    whole = canvas.text("a very long name of an object", 0, 0, 20)
    cut = canvas.text("a very long name of an object", 0, 30, 20, width=120)
    assert cut <= 120 < whole
    assert canvas.pixels().shape == (60, 300, 3)


def test_views_are_chosen_for_what_they_show(capture):
    empty = torch.zeros(48, 64, dtype=torch.int16)
    shows = {1: empty.clone(), 4: empty.clone()}
    shows[1][:4, :4], shows[4][:20, :20] = 5, 6
    views = replace(capture, frames=lambda index: replace(capture[index], ids=shows.get(index, empty)))
    assert choose_views(views, 2) == [1, 4]
    assert choose_views(views, 1) == [4]
    assert choose_views(views, 99) == list(range(6))
    blind = replace(capture, frames=lambda index: replace(capture[index], ids=None))
    assert len(choose_views(blind, 3)) == 3


@pytest.mark.parametrize("count", [0, 1, 8, 9, 40])
def test_the_overview_holds_any_number_of_objects(capture, count, monkeypatch):
    for name in ("portrait", "dollhouse"):
        monkeypatch.setattr(f"goc.report.overview.{name}", lambda mesh, up, size: np.zeros((size, size, 3), np.uint8))
    scene = box_scene()
    many = tuple(replace(scene.objects[n % 2], id=n + 1) for n in range(count))
    scene = replace(scene, objects=many, world=replace(scene.world, metric=False))
    events = []
    record = RunRecord(events.append)
    page = draw_overview(scene, capture, "many", 2, record)
    rows = 2 + max(0, -(-(count - 8) // 6))
    assert page.shape[1] == 1720
    assert page.shape[0] > 2 * 300 + rows * 300
    assert events[-1].done == events[-1].total == 3 + count


def test_objects_are_pictured_and_measured_as_far_as_they_are_there():
    first = box_scene().objects[0]
    assert _measures(first, 1.0) == "0.90 x 0.80 x 0.70 m · 12 faces"
    closed = replace(first, solid=first.observed)
    assert _measures(closed, 10.0).startswith("0.09 x 0.08 x 0.07 m · ") and _measures(closed, 1.0).endswith("% filled")
    assert _measures(replace(first, observed=None), 1.0) == "no surface"


def test_the_number_of_views_has_bounds():
    with pytest.raises(ConfigError, match=r"ExportConfig\.overview_views is 0: needs 1 to 40"):
        ExportConfig(overview_views=0)
