"""A capture is handed to a worker process at every stage: the same views there, and no decoded image on the way."""

import json
import os
import pickle  # noqa: TID251 - to measure what is sent; nothing is read from a file
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

import pytest
import torch

import captures
from assets import box_splats
from cameras import pinhole
from goc.capture import CaptureConfig, load_capture
from goc.extract import rendered_views
from goc.priors.segmentation import SegmentConfig, segment
from goc.reconstruct.labels import classified_views, new_classifier
from goc.reconstruct.monocular import ROW, aligned_capture
from goc.scene import Capture, Gaussians
from goc.scene.cache import bytes_of
from workers import digest, digests

VIEWS, THOUSAND = 6, 1000


def plain(folder):
    return load_capture(captures.write_nerfstudio(folder))


def distorted_and_scaled(folder):
    captures.with_normals(captures.write_nerfstudio(folder, lens=captures.BENT), captures.BENT)
    return load_capture(folder, CaptureConfig(max_side_px=40))


def rgbd_with_codes(folder):
    folder = captures.write_rgbd(folder, change=lambda meta: meta.update(instance_background=2, mask_values=[1, 2]))
    return load_capture(folder)


def segmented(folder):
    captures.write_nerfstudio(folder)
    return segment(load_capture(folder, CaptureConfig(use_ids=False)), SegmentConfig())


def rendered(folder):
    return rendered_views(box_splats(), plain(folder))


def rendered_over_segmented(folder):
    """What a carve of depth without ids looks at: three layers, each with its cache."""
    return rendered_views(box_splats(), segmented(folder))


def aligned(folder):
    captures.write_nerfstudio(folder, change=lambda document: document.update(depth_kind="affine"))
    rows = torch.zeros(VIEWS, ROW)
    rows[:, 0] = torch.linspace(0.5, 1.5, VIEWS)
    rows[2, 0] = torch.nan  # a view that is not aligned
    return aligned_capture(load_capture(folder), rows)


def classified(folder):
    generator = torch.Generator().manual_seed(0)
    splats = box_splats().gaussians
    splats = replace(splats, identity=torch.randn(len(splats), 4, generator=generator))
    return classified_views(splats, new_classifier(3, 4, generator), [0, 1, 2], plain(folder))


STAGES = (
    plain,
    distorted_and_scaled,
    rgbd_with_codes,
    segmented,
    rendered,
    rendered_over_segmented,
    aligned,
    classified,
)


@pytest.fixture(scope="module")
def worker():
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        yield pool


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: stage.__name__)
def test_a_worker_sees_the_same_views_and_no_decoded_image_is_sent(stage, tmp_path, worker):
    capture = stage(tmp_path)
    before = len(pickle.dumps(capture))
    expected = [digest(frame) for frame in capture]
    process, found = worker.submit(digests, capture).result()
    assert process != os.getpid()
    assert found == expected and len(set(found)) == VIEWS
    assert len(pickle.dumps(capture)) <= before + 200  # what paths and numbers remember of themselves


def test_a_thousand_views_are_sent_in_less_than_a_megabyte(tmp_path, worker):
    captures.write_nerfstudio(tmp_path, views=1)
    document = json.loads((tmp_path / "transforms.json").read_text())
    entry, folders = document["frames"][0], {"file_path": "images", "depth_file_path": "depth"}
    for number in range(1, THOUSAND):
        named = {key: f"{folder}/{number:04d}.png" for key, folder in folders.items()}
        for name in named.values():
            (tmp_path / name).hardlink_to(tmp_path / name.replace(f"{number:04d}", "0000"))
        document["frames"].append({"transform_matrix": entry["transform_matrix"], **named})
    (tmp_path / "transforms.json").write_text(json.dumps(document))
    capture = load_capture(tmp_path, CaptureConfig(use_ids=False, checks="off"))
    capture[0]
    assert len(capture) == THOUSAND and len(pickle.dumps(capture)) < 1e6
    _, found = worker.submit(digests, capture).result()
    assert len(found) == THOUSAND
    assert not any(camera.world_from_cam.is_shared() for camera in capture.cameras)  # each would be an open file


def test_layers_that_share_a_cache_share_it_where_they_arrive(tmp_path):
    capture = segmented(tmp_path)
    arrived = pickle.loads(pickle.dumps(capture))
    assert isinstance(arrived, Capture)
    arrived.frames.ids(0)  # asks for the depth of the layer below
    assert arrived.frames.below.held == bytes_of(capture[0]) - capture[0].ids.nbytes


def test_cameras_and_splats_arrive_as_they_were():
    camera = pinhole((50.0, 51.0), centre=(31.0, 24.5)).double()
    splats = replace(box_splats().gaussians, identity=None)
    arrived, landed = pickle.loads(pickle.dumps((camera, splats)))
    assert (arrived.width, arrived.height) == (64, 48)
    assert torch.equal(arrived.focal_px, camera.focal_px) and arrived.world_from_cam.dtype == torch.float64
    assert isinstance(landed, Gaussians) and landed.identity is None
    assert torch.equal(landed.means, splats.means) and torch.equal(landed.sh, splats.sh)
