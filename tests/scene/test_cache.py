from concurrent.futures import ThreadPoolExecutor
from multiprocessing.reduction import ForkingPickler

import pytest
import torch

from cameras import pinhole
from captures import write_nerfstudio
from goc.capture import CaptureConfig, load_capture
from goc.scene import Frame, StoredFrames, ViewCache
from goc.scene.cache import bytes_of


def frame(index):
    return Frame(camera=pinhole(1.0, (10, 10)), image=torch.full((10, 10, 3), index, dtype=torch.uint8))


class Counting:
    def __init__(self, compute=frame):
        self.calls, self.compute = [], compute

    def __call__(self, index):
        self.calls.append(index)
        return self.compute(index)


def test_views_within_the_budget_are_computed_once():
    decode = Counting()
    cache = ViewCache(decode, budget=900)
    for index in (0, 1, 2, 0, 2):
        assert cache(index).image[0, 0, 0] == index
    assert decode.calls == [0, 1, 2]
    assert cache.held == 900


def test_views_beyond_the_budget_take_turns_and_the_first_ones_stay():
    decode = Counting()
    cache = ViewCache(decode, budget=600)
    for index in (0, 1, 2, 3, 2, 4, 2, 0, 1):  # 2 and 3 are the fresh ones, then 3 and 4
        assert cache(index).image[0, 0, 0] == index
    assert decode.calls == [0, 1, 2, 3, 4, 2]
    assert cache.held == 600


def test_going_through_all_views_finds_as_many_as_fit():
    decode = Counting()
    cache = ViewCache(decode, budget=900)
    for _ in range(4):
        for index in range(10):
            cache(index)
    assert len(decode.calls) == 10 + 3 * 7


def test_without_a_budget_a_step_still_decodes_its_two_views_once():
    decode = Counting()
    cache = ViewCache(decode, budget=0)
    for index in (7, 3, 7, 3):
        cache(index)
    assert decode.calls == [7, 3]
    assert cache.held == 0


def test_images_are_kept_as_frames_are():
    """What is in the cache is told by its index, not by its value: an image of zeros is as good as any."""
    compute = Counting(lambda index: torch.zeros(4, 5, dtype=torch.int16))
    cache = ViewCache(compute, budget=100)
    for index in (0, 1, 2, 3, 0, 1, 2, 3):
        assert cache(index).shape == (4, 5)
    assert compute.calls == [0, 1, 2, 3]
    assert cache.held == 80


def test_a_cache_that_is_sent_arrives_empty_with_its_budget():
    cache = ViewCache(StoredFrames(tuple(frame(index) for index in range(3))), budget=600)
    for index in range(3):
        cache(index)
    arrived = ForkingPickler.loads(ForkingPickler.dumps(cache))
    assert cache.held == 600 and arrived.held == 0
    for index in (0, 1, 2, 0):
        assert torch.equal(arrived(index).image, frame(index).image)
    assert arrived.held == 600


def test_many_threads_get_the_right_views(tmp_path):
    capture = load_capture(write_nerfstudio(tmp_path), CaptureConfig(cache_mb=0))
    expected = [view.image for view in capture]
    with ThreadPoolExecutor(4) as pool:
        for index, got in enumerate(pool.map(lambda number: capture[number % 6], range(60))):
            assert torch.equal(got.image, expected[index % 6])


@pytest.mark.parametrize(("value", "expected"), [(torch.zeros(5, 7), 140), (frame(0), 300)])
def test_bytes_are_those_of_tensors(value, expected):
    assert bytes_of(value) == expected


def test_bytes_count_every_image(tmp_path):
    view = load_capture(write_nerfstudio(tmp_path, views=1))[0]
    assert bytes_of(view) == 64 * 48 * (3 + 4 + 2)
