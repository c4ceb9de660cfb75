"""Canvas and palette: what pictures and words on a page keep, and that colours tell ids and depths apart."""

import numpy as np
import pytest

from goc.report.canvas import INK, Canvas, plain
from goc.report.palette import colour_of_id, colours_of_depth, colours_of_ids
from goc.scene import ROOM, UNLABELLED
from laws import SCALES, over


def ink_box(page: Canvas) -> tuple[int, int, int, int]:
    """left, top, right, bottom of what is not paper."""
    marked = (np.abs(page.pixels().astype(int) - [250, 250, 248]) > 8).any(-1)
    rows, columns = np.flatnonzero(marked.any(1)), np.flatnonzero(marked.any(0))
    return columns[0], rows[0], columns[-1] + 1, rows[-1] + 1


@pytest.mark.parametrize("shape", [(40, 40), (20, 80), (90, 30), (1, 1), (200, 10)])
@pytest.mark.parametrize("box", [(60, 60), (100, 20), (7, 50)])
def test_pictures_are_fitted_centred_and_keep_their_proportions(shape, box):
    page = Canvas(160, 120)
    page.picture(np.full((*shape, 3), (200, 0, 0), np.uint8), 30, 20, *box)
    left, top, right, bottom = ink_box(page)
    assert left >= 30 and top >= 20 and right <= 30 + box[0] and bottom <= 20 + box[1]
    scale = min(box[0] / shape[1], box[1] / shape[0])
    assert abs(right - left - max(1, scale * shape[1])) <= 1 and abs(bottom - top - max(1, scale * shape[0])) <= 1
    assert abs((left - 30) - (30 + box[0] - right)) <= 1 and abs((top - 20) - (20 + box[1] - bottom)) <= 1


def test_a_picture_of_the_size_of_its_box_is_not_touched():
    pixels = np.random.default_rng(0).integers(0, 256, (30, 50, 3), dtype=np.uint8)
    page = Canvas(80, 60)
    page.picture(pixels, 10, 15, 50, 30)
    np.testing.assert_array_equal(page.pixels()[15:45, 10:60], pixels)
    assert (page.pixels()[:15] == [250, 250, 248]).all()


@pytest.mark.parametrize("width", [20, 60, 120, 400])
@pytest.mark.parametrize("words", ["", "a", "a line of several words", "W" * 60])
def test_words_stay_within_their_width(words, width):
    page = Canvas(700, 40)
    told = page.text(words, 10, 5, 16, width)
    assert told <= width or len(words) == 1
    if words:
        left, _, right, _ = ink_box(page)
        assert left >= 9 and right <= 10 + max(told, 16) + 2
    longer = page.text(words, 10, 5, 16, 2 * width)
    assert longer >= told


def test_chips_are_where_and_as_large_as_asked():
    page = Canvas(60, 60)
    page.chip(20, 12, 16, INK)
    assert ink_box(page) == (20, 12, 37, 29)
    assert tuple(page.pixels()[20, 28]) == INK


@pytest.mark.parametrize(
    ("words", "shown"),
    [("plain", "plain"), ("café Ü", "cafe U"), ("1…2·3", "1...2·3"), ("椅子", "??"), ("a\tb\n", "a?b?"), ("", "")],
)
def test_letters_become_those_that_the_font_has(words, shown):
    assert plain(words) == shown
    assert plain(plain(words)) == plain(words)


def test_neighbouring_ids_are_told_apart_and_none_is_the_room():
    colours = np.array([colour_of_id(n) for n in range(1, 41)], float)
    apart = np.linalg.norm(colours[:, None] - colours[None], axis=-1) + 1e3 * np.eye(40)
    assert np.diagonal(apart, 1).min() > 80  # from one id to the next
    assert apart[:12, :12].min() > 25  # any two of the first dozen
    for special in (colour_of_id(ROOM), colour_of_id(UNLABELLED)):
        assert np.linalg.norm(colours - special, axis=1).min() > 40


@pytest.mark.parametrize("shape", [(1, 1), (4, 7), (30, 2)])
def test_id_pictures_are_the_colours_of_their_ids(shape):
    ids = np.random.default_rng(1).integers(-1, 300, shape).astype(np.int16)
    picture = colours_of_ids(ids)
    for index in np.ndindex(*shape):
        assert tuple(picture[index]) == colour_of_id(int(ids[index]))


@over(scale=SCALES)
def test_depth_colours_do_not_depend_on_the_unit_and_darken_with_depth(scale):
    depth = np.linspace(0.5, 6.0, 60).reshape(6, 10)
    picture = colours_of_depth(depth, 1.0, 5.0)
    scaled = colours_of_depth(scale * depth, scale, 5 * scale)
    assert np.abs(picture.astype(int) - scaled).max() <= 1
    light = picture.reshape(-1, 3) @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(light) <= 1e-9).all() and light[0] > 200 and light[-1] < 40
    np.testing.assert_array_equal(picture[0, 0], colours_of_depth(np.array([[1.0]]), 1.0, 5.0)[0, 0])


@pytest.mark.parametrize("hole", [np.nan, np.inf, -np.inf])
def test_holes_are_grey_and_change_nothing_else(hole):
    depth = np.full((3, 4), 2.0)
    whole = colours_of_depth(depth, 1.0, 3.0)
    depth[1, 2] = hole
    holed = colours_of_depth(depth, 1.0, 3.0)
    assert tuple(holed[1, 2]) == colour_of_id(UNLABELLED)
    holed[1, 2] = whole[1, 2]
    np.testing.assert_array_equal(holed, whole)


def test_one_depth_everywhere_is_a_colour():
    assert (colours_of_depth(np.full((2, 2), 3.0), 3.0, 3.0) == colours_of_depth(np.full((2, 2), 1.0), 1.0, 2.0)).all()
