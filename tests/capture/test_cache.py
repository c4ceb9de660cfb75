from concurrent.futures import ThreadPoolExecutor

import pytest
import torch

from captures import write_nerfstudio
from goc.capture import CaptureConfig, load_capture
from goc.capture.cache import FrameCache, bytes_of
from goc.scene import Camera, Frame


def frame(index):
    camera = Camera(focal_px=torch.ones(2), centre_px=torch.ones(2), width=10, height=10, world_from_cam=torch.eye(4))
    return Frame(camera=camera, image=torch.full((10, 10, 3), index, dtype=torch.uint8))


class Counting:
    def __init__(self):
        self.calls = []

    def __call__(self, index):
        self.calls.append(index)
        return frame(index)


def test_views_within_the_budget_are_decoded_once():
    decode = Counting()
    cache = FrameCache(decode, count=3, budget=900)
    for index in (0, 1, 2, 0, -3, 2):
        assert cache(index).image[0, 0, 0] == index % 3
    assert decode.calls == [0, 1, 2]
    assert cache.held == 900


def test_views_beyond_the_budget_take_turns_and_the_first_ones_stay():
    decode = Counting()
    cache = FrameCache(decode, count=6, budget=600)
    for index in (0, 1, 2, 3, 2, 4, 2, 0, 1):  # 2 and 3 are the fresh ones, then 3 and 4
        assert cache(index).image[0, 0, 0] == index
    assert decode.calls == [0, 1, 2, 3, 4, 2]
    assert cache.held == 600


def test_going_through_all_views_finds_as_many_as_fit():
    decode = Counting()
    cache = FrameCache(decode, count=10, budget=900)
    for _ in range(4):
        for index in range(10):
            cache(index)
    assert len(decode.calls) == 10 + 3 * 7


def test_without_a_budget_a_step_still_decodes_its_two_views_once():
    decode = Counting()
    cache = FrameCache(decode, count=9, budget=0)
    for index in (7, 3, 7, 3):
        cache(index)
    assert decode.calls == [7, 3]
    assert cache.held == 0


def test_views_that_are_not_there_are_index_errors():
    cache = FrameCache(frame, count=2, budget=0)
    for index in (2, -3):
        with pytest.raises(IndexError):
            cache(index)


def test_many_threads_get_the_right_views(tmp_path):
    capture = load_capture(write_nerfstudio(tmp_path), CaptureConfig(cache_mb=0))
    expected = [view.image for view in capture]
    with ThreadPoolExecutor(4) as pool:
        for index, got in enumerate(pool.map(lambda number: capture[number % 6], range(60))):
            assert torch.equal(got.image, expected[index % 6])


def test_bytes_count_every_image(tmp_path):
    view = load_capture(write_nerfstudio(tmp_path, views=1))[0]
    assert bytes_of(view) == 64 * 48 * (3 + 4 + 2)
