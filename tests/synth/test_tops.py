import numpy as np
import pytest

from goc.geometry.raycast import TriangleScene
from goc.synth.collision import collision_mesh, height_above, interpenetrate
from goc.synth.materials import Paint
from goc.synth.model import Model, make_part, placed
from goc.synth.shapes import ball, lathe, rounded_box
from goc.synth.tops import find_tops, largest_rectangle
from meshfolder import joined, table


def scene_of(solid):
    return TriangleScene(solid.vertices.astype(np.float32), solid.faces.astype(np.int32))


def hull(solid, x=0.0, y=0.0, z=0.0):
    return collision_mesh(Model(name="x", parts=(placed(make_part(solid, Paint(base=(0.5, 0.5, 0.5))), x, y, z),)))


def test_the_top_of_a_table_is_its_plate():
    (top,) = find_tops(scene_of(table(1.1, 0.7, 0.7)))
    assert (top.x, top.y, top.z) == pytest.approx((0, 0, 0.7), abs=0.01) and top.clearance == np.inf
    assert top.width == pytest.approx(1.1, abs=0.035) and top.depth == pytest.approx(0.7, abs=0.035)
    assert top.width < 1.1 and top.depth < 0.7


def test_boards_of_a_shelf_are_tops_with_the_air_between_them():
    boards = [rounded_box((0.8, 0.3, 0.02)).moved(z=z) for z in (0.3, 0.7, 0.75, 1.1)]
    tops = find_tops(scene_of(joined(*boards)))
    found = {round(top.z, 2): round(min(top.clearance, 9.0), 2) for top in tops}
    assert found == {0.32: 0.38, 0.77: 0.33, 1.12: 9.0}  # above the board at 0.7 there are 3 cm of air


def test_what_stands_on_a_top_is_left_out():
    solid = joined(table(1.2, 0.7, 0.7), rounded_box((0.1, 0.7, 0.3)).moved(x=0.1, z=0.7))
    wide, narrow = [top for top in find_tops(scene_of(solid)) if top.z < 0.8][:2]
    assert wide.x + wide.width / 2 < 0.05 + 0.01 and wide.width == pytest.approx(0.65, abs=0.04)
    assert narrow.x - narrow.width / 2 > 0.15 - 0.01 and narrow.width == pytest.approx(0.45, abs=0.04)


def test_round_sloping_and_hollow_things_have_no_tops():
    sloping = rounded_box((0.8, 0.5, 0.3)).turned("y", 0.3)
    cup = lathe(np.array([[0, 0], [0.05, 0], [0.06, 0.5], [0.055, 0.5], [0.045, 0.01], [0, 0.01]]))
    for solid in (ball(0.4), sloping, cup):
        assert find_tops(scene_of(solid)) == ()


def test_the_largest_rectangle_is_that_of_trying_all():
    rng = np.random.default_rng(0)
    for _ in range(30):
        free = rng.random((6, 7)) < 0.75
        free[0, 0] = True
        i0, i1, j0, j1 = largest_rectangle(free)
        best = max(
            (b - a) * (d - c)
            for a in range(6) for b in range(a + 1, 7) for c in range(7) for d in range(c + 1, 8)
            if free[a:b, c:d].all()
        )  # fmt: skip
        assert free[i0:i1, j0:j1].all() and (i1 - i0) * (j1 - j0) == best


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        ((0.0, 0.0, 0.5), False),  # stands on it
        ((0.0, 0.0, 0.497), True),  # stands 3 mm deep in it
        ((0.3, 0.0, 0.2), True),  # one side in it
        ((0.0, 0.0, 0.15), True),  # wholly inside
        ((0.56, 0.0, 0.2), False),  # beside it
        ((2.0, 0.0, 0.2), False),
    ],
)
def test_things_share_space_only_where_they_do(place, expected):
    large, small = hull(rounded_box((1.0, 1.0, 0.5))), hull(rounded_box((0.1, 0.1, 0.1)), *place)
    assert interpenetrate(small, large) == expected
    if place[2] < 0.49:
        assert interpenetrate(large, small) == expected


def test_how_far_a_thing_sinks_until_it_touches():
    plate = hull(table())
    assert height_above(hull(rounded_box((0.2, 0.2, 0.2)), z=0.707), plate) == pytest.approx(0.007, abs=1e-5)
    assert height_above(hull(ball(0.1), z=0.695), plate) == pytest.approx(-0.005, abs=1e-5)
    assert height_above(hull(ball(0.1), x=3.0, z=0.7), plate) == np.inf
    # A nail below: its tip meets the flat side above it.
    nail = hull(joined(rounded_box((0.5, 0.5, 0.1)), rounded_box((0.02, 0.02, 0.012)).moved(z=0.1)))
    assert height_above(hull(rounded_box((0.3, 0.3, 0.1)), z=0.115), nail) == pytest.approx(0.003, abs=1e-5)
