"""Id images of any coding."""

import numpy as np
import pytest
from PIL import Image

from goc.capture.masks import ids_of, understood
from goc.capture.pixels import ObjectMasks, RawNumbers
from goc.capture.source import IdCodes
from goc.errors import CaptureError, FileError
from goc.files import read_codes, write_png
from goc.scene import UNLABELLED

IDS = np.zeros((40, 60), np.uint8)
IDS[5:20, 5:30] = 3
IDS[15:35, 25:50] = 12


def decoded(tmp_path, images, codes=None):
    paths, heard = [], []
    for number, pixels in enumerate(images):
        paths.append(tmp_path / f"{number}.png")
        pixels.save(paths[-1]) if isinstance(pixels, Image.Image) else write_png(paths[-1], pixels)
    found = understood(tmp_path, paths, codes or IdCodes(), heard.append)
    return [ids_of(path, read_codes(path), found) for path in paths], [event.message for event in heard]


def test_plain_ids_stay_what_they_are(tmp_path):
    (ids, wide), heard = decoded(tmp_path, [IDS, IDS.astype(np.uint16) * 100])
    np.testing.assert_array_equal(ids, IDS)
    np.testing.assert_array_equal(wide, IDS.astype(int) * 100)
    assert heard == []


def test_palette_indices_are_ids(tmp_path):
    picture = Image.fromarray(IDS, "L").convert("P") if False else Image.fromarray(IDS)
    picture = picture.convert("L").convert("P")
    picture.putpalette([value for index in range(256) for value in (index, 255 - index, 7)])
    (ids,), _ = decoded(tmp_path, [picture])
    np.testing.assert_array_equal(ids, np.asarray(picture))


def test_colours_are_numbered_over_all_views_and_black_is_the_room(tmp_path):
    palette = np.zeros((256, 3), np.uint8)
    palette[3], palette[12], palette[20] = (9, 200, 30), (250, 10, 10), (128, 128, 128)
    grey = np.where(IDS == 3, 20, 0)  # a view whose only colour is grey
    (one, other), heard = decoded(tmp_path, [palette[IDS], palette[grey]])
    np.testing.assert_array_equal(one, np.select([IDS == 3, IDS == 12], [1, 3]))  # by ascending code
    np.testing.assert_array_equal(other, np.where(IDS == 3, 2, 0))
    assert heard == ["Id images are coloured: 3 colours became ids 1 to 3, black is the room"]


def test_nothing_but_0_and_255_is_one_object(tmp_path):
    (ids,), heard = decoded(tmp_path, [np.where(IDS == 3, 255, 0).astype(np.uint8)])
    np.testing.assert_array_equal(ids, IDS == 3)
    assert "255 is taken for one object" in heard[0]
    (ids,), heard = decoded(tmp_path, [np.where(IDS == 3, 255, 0).astype(np.uint8)], IdCodes(unknown=255))
    assert heard == [] and set(np.unique(ids)) == {UNLABELLED, 0}


def test_smoothed_ids_lose_their_edges_and_nothing_else(tmp_path):
    smooth = Image.fromarray(np.kron(IDS, np.ones((4, 4), np.uint8))).resize((120, 80), Image.Resampling.LANCZOS)
    (ids,), heard = decoded(tmp_path, [smooth])
    truth = np.kron(IDS, np.ones((2, 2), int))
    assert set(np.unique(ids)) <= {UNLABELLED, 0, 3, 12}
    assert (ids[ids >= 0] == truth[ids >= 0]).all()
    assert (ids < 0).mean() < 0.25
    assert "scaled with smoothing" in heard[0]


def test_photographs_are_no_ids(tmp_path):
    noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3)).astype(np.uint8)
    blocks = np.kron(noise, np.ones((3, 3, 1), np.uint8))
    with pytest.raises(CaptureError, match="more than 2000 colours .* Write one colour an object, as PNG"):
        decoded(tmp_path, [blocks])


def test_a_table_says_what_values_mean(tmp_path):
    codes = IdCodes(table=((1, 0), (3, 7), (255, 0)), others=UNLABELLED)
    stored = np.array([[0, 1, 3, 4, 255]], np.uint8)
    np.testing.assert_array_equal(ids_of(tmp_path, stored, codes), [[UNLABELLED, 0, 7, UNLABELLED, 0]])
    with pytest.raises(CaptureError, match="holds id 40000, beyond 32767"):
        ids_of(tmp_path, np.array([[40000]], np.uint16), IdCodes())


def test_one_binary_image_an_object(tmp_path):
    for number in (3, 12):
        write_png(tmp_path / f"{number}.png", np.where(IDS == number, 255, 0).astype(np.uint8))
    masks = ObjectMasks(tuple((number, tmp_path / f"{number}.png") for number in (3, 12)))
    assert masks.size() == (60, 40)
    np.testing.assert_array_equal(masks.read(), IDS)
    write_png(tmp_path / "12.png", np.zeros((4, 4), np.uint8))
    with pytest.raises(FileError, match=r"12\.png: 4 x 4 pixels, but 3\.png has 60 x 40"):
        masks.read()


def test_numbers_without_a_header_need_their_shape(tmp_path):
    values = np.arange(12, dtype="<f4").reshape(3, 4)
    (tmp_path / "a.bin").write_bytes(b"head" + values.tobytes())
    np.testing.assert_array_equal(RawNumbers(tmp_path / "a.bin", 4, 3, "<f4", 4).read(), values)
    with pytest.raises(FileError, match="52 bytes, but 5 x 3 numbers of float32 take 64"):
        RawNumbers(tmp_path / "a.bin", 5, 3, "<f4", 4).read()
