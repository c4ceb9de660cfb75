"""Stage 2 as a whole, on a tiny room of boxes: it learns, repeats itself, resumes, and labels."""

from dataclasses import fields, replace
from pathlib import Path

import pytest
import torch

import captures
from cameras import pinhole
from goc import _native
from goc.capture import CaptureConfig, load_capture
from goc.errors import ConfigError, ReconstructError
from goc.events import Snapshot
from goc.raster import render_labels
from goc.reconstruct import Losses, Mcmc, ReconstructConfig, geometry_prior, reconstruct, split_views, vote_labels
from goc.reconstruct.labels import capture_ids, votes_of_view
from goc.reconstruct.losses.identity import classes_of
from goc.reconstruct.seed import splat_budget
from goc.reconstruct.step import identity_stride
from goc.scene import UNLABELLED, Capture, CapturePriors, Gaussians

QUICK = ReconstructConfig(iterations=60, checkpoint_every=20, mcmc=Mcmc(max_splats=1500, every=10))


class Stopped(Exception):
    """Stands for a killed process."""


@pytest.fixture(scope="module")
def capture(tmp_path_factory) -> Capture:
    return load_capture(captures.write_nerfstudio(tmp_path_factory.mktemp("room"), views=8), CaptureConfig())


def same(a: Gaussians, b: Gaussians) -> bool:
    pairs = [(getattr(a, item.name), getattr(b, item.name)) for item in fields(Gaussians)]
    return all((x is None and y is None) or torch.equal(x, y) for x, y in pairs)


def label_agreement(capture: Capture, found) -> float:
    frame = capture[0]
    ids = render_labels(found.gaussians, found.labels, frame.camera)
    return (ids == frame.ids)[frame.ids != UNLABELLED].float().mean().item()


def test_splats_come_to_show_the_photographs(capture):
    first = reconstruct(capture, replace(QUICK, iterations=1, checkpoint_every=0)).metrics["train_psnr_db"]
    found = reconstruct(capture, replace(QUICK, iterations=150, checkpoint_every=0))
    assert found.metrics["train_psnr_db"] > first + 4
    assert found.metrics["train_median_depth_error_m"] < 0.015
    assert label_agreement(capture, found) > 0.95


def test_whoever_watches_sees_the_splats_grow_and_changes_nothing(capture):
    config, seen = replace(QUICK, iterations=110, checkpoint_every=0), []

    def watch(event):
        if isinstance(event, Snapshot):
            seen.append((event.step, event.splats[torch.arange(len(event.splats))]))

    watched, alone = reconstruct(capture, config, watch), reconstruct(capture, config)
    assert [step for step, _ in seen] == [50, 100, 110]
    assert not seen[0][1].means.requires_grad and not same(seen[1][1], seen[2][1])
    assert same(seen[2][1], watched.gaussians) and same(watched.gaussians, alone.gaussians)


def test_learned_features_label_the_same_objects(capture):
    config = replace(QUICK, iterations=150, checkpoint_every=0, labels="learned")
    found = reconstruct(capture, config)
    assert found.gaussians.identity is not None
    assert label_agreement(capture, found) > 0.9


@pytest.mark.parametrize("labels", ["votes", "learned"])
def test_a_stopped_run_resumes_bit_equal(capture, tmp_path, labels):
    config = replace(QUICK, labels=labels)
    whole = reconstruct(capture, config)

    def stop(event):
        if event.stage == "reconstruct" and event.done == 47:
            raise Stopped

    checkpoint = tmp_path / "checkpoint.safetensors"
    with pytest.raises(Stopped):
        reconstruct(capture, config, stop, checkpoint)
    heard = []
    resumed = reconstruct(capture, config, heard.append, checkpoint, resume=True)
    assert next(event.done for event in heard if event.stage == "reconstruct") == 41
    assert same(whole.gaussians, resumed.gaussians)
    assert torch.equal(whole.labels, resumed.labels)


def test_the_same_seed_gives_the_same_bits_for_any_number_of_threads(capture):
    before, results = _native.thread_count(), []
    for threads in (1, 3):
        _native.set_thread_count(threads)
        results.append(reconstruct(capture, replace(QUICK, iterations=20, checkpoint_every=0)).gaussians)
    _native.set_thread_count(before)
    assert same(*results)
    other = reconstruct(capture, replace(QUICK, iterations=20, checkpoint_every=0, seed=1)).gaussians
    assert not same(results[0], other)


def test_a_checkpoint_of_other_settings_is_refused(capture, tmp_path):
    checkpoint = tmp_path / "checkpoint.safetensors"
    reconstruct(capture, replace(QUICK, iterations=20), checkpoint=checkpoint)
    with pytest.raises(ReconstructError, match="made from another capture or with other settings"):
        reconstruct(capture, replace(QUICK, iterations=20, seed=3), checkpoint=checkpoint, resume=True)
    other = replace(capture, priors=CapturePriors(settings='{"bend":false}'))
    with pytest.raises(ReconstructError, match="made from another capture or with other settings"):
        reconstruct(other, replace(QUICK, iterations=20), checkpoint=checkpoint, resume=True)


def test_seeds_without_depth_come_from_points_then_from_the_box(tmp_path):
    folder = captures.write_nerfstudio(tmp_path, views=8)
    blind = load_capture(folder, CaptureConfig(use_depth=False))
    assert blind.points is not None and not blind.has_depth
    config = replace(QUICK, iterations=40, checkpoint_every=0)
    from_points = reconstruct(blind, config).gaussians
    assert len(from_points) > len(blind.points.positions)  # MCMC grew them
    config = replace(config, seeding=replace(config.seeding, random_points=400))
    from_box = reconstruct(replace(blind, points=None), config)
    assert 400 <= len(from_box.gaussians) <= 1500
    assert torch.isfinite(from_box.gaussians.means).all()
    unmatched = replace(blind, priors=CapturePriors(stereo={}))  # few points, and photographs that match nowhere
    assert len(reconstruct(unmatched, replace(config, iterations=1)).gaussians) == 400


def test_every_loss_is_switched_off_by_its_weight(capture):
    config = replace(QUICK, iterations=5, checkpoint_every=0)
    plain = reconstruct(capture, config).gaussians
    for weights in (Losses(depth=0.0), Losses(depth_normal=0.0), Losses(depth=0.0, depth_normal=0.0)):
        assert not same(plain, reconstruct(capture, replace(config, losses=weights)).gaussians)
    learned = replace(config, labels="learned")
    without = replace(learned, losses=Losses(identity=0.0))
    assert not same(reconstruct(capture, learned).gaussians, reconstruct(capture, without).gaussians)


def test_votes_follow_the_masks(capture):
    gaussians = reconstruct(capture, replace(QUICK, iterations=20, checkpoint_every=0)).gaussians
    views = list(range(len(capture)))
    labels = vote_labels(gaussians, capture, views)
    blank = replace(capture, frames=lambda index: replace(capture[index], ids=None))
    assert (vote_labels(gaussians, blank, views) == UNLABELLED).all()
    assert set(torch.unique(labels).tolist()) <= {UNLABELLED, *range(20)}


def test_a_view_that_spoils_the_loss_is_named(capture):
    loads = iter(range(1000))

    def spoilt(index: int):
        frame = capture[index]
        if next(loads) < len(capture):  # good for the seeds
            return frame
        normals = torch.full((*frame.ids.shape, 3), 3.4e38)
        return replace(frame, normals=normals)

    with pytest.raises(ReconstructError, match=r"images/.*: the loss is not finite at step 0"):
        reconstruct(replace(capture, frames=spoilt), QUICK)


def test_too_few_views_or_points_are_refused(capture):
    alone = replace(capture, cameras=capture.cameras[:1], view_names=capture.view_names[:1])
    with pytest.raises(ReconstructError, match=r"1 training view\(s\): reconstruction needs at least 2"):
        reconstruct(alone, QUICK)
    empty = replace(
        capture, frames=lambda index: replace(capture[index], depth=torch.full_like(capture[index].depth, torch.nan))
    )
    with pytest.raises(ReconstructError, match="only 0 points to start from in 8 views"):
        reconstruct(empty, QUICK)


@pytest.mark.parametrize(("count", "every", "held"), [(40, 10, [5, 15, 25, 35]), (40, 0, []), (10, 5, [])])
def test_split_views(count, every, held):
    train, held_out = split_views(count, every)
    assert held_out == held
    assert sorted(train + held_out) == list(range(count))


def test_checkpoints_are_whole_files(capture, tmp_path):
    checkpoint = tmp_path / "checkpoint.safetensors"
    reconstruct(capture, replace(QUICK, iterations=40), checkpoint=checkpoint)
    assert [path.name for path in Path(tmp_path).iterdir()] == ["checkpoint.safetensors"]


def test_small_views_get_fewer_splats(capture):
    assert splat_budget(capture, ReconstructConfig()) == 64 * 48
    assert splat_budget(capture, QUICK) == 1500
    large = replace(capture, cameras=tuple(camera.resized(640, 480) for camera in capture.cameras))
    assert splat_budget(large, ReconstructConfig()) == ReconstructConfig().mcmc.max_splats


def test_votes_of_the_ids_in_view_are_the_votes_of_all_ids(capture):
    gaussians = reconstruct(capture, replace(QUICK, iterations=5, checkpoint_every=0)).gaussians
    views = list(range(len(capture)))
    names = capture_ids(capture, views)
    total = sum(votes_of_view(gaussians, capture.cameras[view], capture[view].ids, names) for view in views)
    expected = torch.tensor(names, dtype=torch.int16)[total.argmax(-1)]
    found = vote_labels(gaussians, capture, views)
    assert torch.equal(found, torch.where(total.sum(-1) > 0, expected, UNLABELLED))
    part = replace(capture, frames=lambda index: replace(capture[index], ids=capture[index].ids.clamp_max(index % 3)))
    assert len(capture_ids(part, [0])) < len(capture_ids(part, views))  # views that show fewer ids than there are
    assert set(torch.unique(vote_labels(gaussians, part, views)).tolist()) <= {UNLABELLED, *capture_ids(part, views)}


def test_classes_are_places_in_the_list_of_names():
    ids = torch.tensor([0, 7, 3, -1, 9, 8], dtype=torch.int16)
    known = torch.tensor([0, 3, 7, 9], dtype=torch.int16)
    assert classes_of(ids, known).tolist() == [0, 2, 1, UNLABELLED, 3, UNLABELLED]


@pytest.mark.parametrize(("size", "stride"), [((48, 64), 1), ((384, 384), 3), ((480, 640), 5)])
def test_identity_loss_keeps_to_its_pixels_wherever_the_grid_starts(size, stride):
    assert identity_stride(size[0] * size[1]) == stride
    assert len(range(0, size[0], stride)) * len(range(0, size[1], stride)) <= 16_384 * 1.02


def test_features_change_only_in_the_steps_that_have_their_loss(capture):
    config = replace(QUICK, checkpoint_every=0, labels="learned", losses=Losses(identity_every=3))
    features = [reconstruct(capture, replace(config, iterations=n)).gaussians.identity for n in (1, 3, 4)]
    assert torch.equal(features[0], features[1])
    assert not torch.equal(features[1], features[2])
    rare = reconstruct(capture, replace(config, iterations=150))
    assert label_agreement(capture, rare) > 0.9
    with pytest.raises(ConfigError, match="Losses.identity_every is 0: needs 1 or more"):
        Losses(identity_every=0)


def test_normals_that_came_first_stay(monkeypatch):
    fitted = []
    monkeypatch.setattr(geometry_prior, "fitted_normals", lambda depth, *_: fitted.append(depth) or torch.ones(4, 5, 3))
    monkeypatch.setattr(geometry_prior, "fitting_radius", lambda *_: 1)
    normals_of = geometry_prior.FittedNormals(budget=2 * 60)
    depth = torch.ones(4, 5)
    for view in (0, 1, 2, 0, 1, 2):
        assert (normals_of(view, 0.0, depth, camera_of(5, 4)) == 127).all()
    assert len(fitted) == 4  # view 2 twice
    normals_of(0, 0.5, depth, camera_of(5, 4))  # another shape of a view that is kept
    normals_of(0, 0.5, depth, camera_of(5, 4))
    assert len(fitted) == 5


def camera_of(width, height):
    return pinhole((width / 2, height / 2), (width, height))
