"""The paper's Fig. 2 on one screen: a capture in, a scene and its objects out."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import torch

from goc.align import AlignConfig, align
from goc.capture import CaptureConfig, load_capture
from goc.complete import CompleteConfig, check_completion, complete_objects
from goc.device import DeviceName, working_device
from goc.events import Listener, ignore
from goc.export import ExportConfig, export_scene
from goc.extract import ExtractConfig, WorldConfig, extract_scene, measured_views, rendered_views
from goc.files import as_json
from goc.files.layout import OVERVIEW, REPORT
from goc.priors import IdsMode, PriorsConfig, SegmentConfig, add_priors, repair_ids, segment
from goc.raster import choose_engine
from goc.reconstruct import LearningRates, Losses, Mcmc, ReconstructConfig, reconstruct, split_views, vote_labels
from goc.report import write_overview, write_report
from goc.runs import RunRecord, claim_output
from goc.scene import Capture, Reconstruction, Scene


@dataclass(frozen=True, kw_only=True)
class CarveConfig:
    """All settings of a run, by stage."""

    device: DeviceName = "auto"
    """Where splats are drawn and optimised, views fused and networks asked. auto: a CUDA device if gsplat works there
    (a trial view decides), else the processor."""
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    """Reading the capture."""
    align: AlignConfig = field(default_factory=AlignConfig)
    """Correcting cameras and photographs, where views do not agree."""
    ids: IdsMode = "auto"
    """Given ids. keep: trusted. repair: made consistent in 3D, whatever each view calls its masks. auto: repaired where
    neighbouring views with metric depth do not agree on them."""
    segment: SegmentConfig = field(default_factory=SegmentConfig)
    """Telling objects apart, where the capture has no ids."""
    priors: PriorsConfig = field(default_factory=PriorsConfig)
    """What photographs and monocular depth say before there are splats."""
    reconstruct: ReconstructConfig = field(default_factory=ReconstructConfig)
    """Optimising the splats."""
    extract: ExtractConfig = field(default_factory=ExtractConfig)
    """Meshing the scene and its objects."""
    world: WorldConfig = field(default_factory=WorldConfig)
    """Up and floor, for those who know them."""
    complete: CompleteConfig = field(default_factory=CompleteConfig)
    """Closing the objects."""
    export: ExportConfig = field(default_factory=ExportConfig)
    """Writing what came out."""


PRESETS = {
    "fast": CarveConfig(),
    "paper": CarveConfig(
        reconstruct=ReconstructConfig(
            iterations=30_000,
            sh_degree=3,
            labels="learned",
            losses=Losses(depth=0.3, depth_normal=0.1, photometric=0.3, geometric=0.3, identity=0.1, identity_every=2),
            rates=LearningRates(means=1.6e-4, opacity_logits=5e-2, sh_constant=2.5e-3, sh_rest=1.25e-4),
            mcmc=Mcmc(growth=0.05),
        )
    ),
}


def carve(
    source: Path, out: Path, config: CarveConfig | None = None, notify: Listener = ignore, resume: bool = False
) -> Scene:
    """Turn a folder of posed photographs into a scene and separate objects (Fig. 2), and write them to `out`.

    Args:
        source: what `load_capture` reads.
        out: new or empty, unless `config.export.overwrite`; see docs/guide/output.md.
        config: PRESETS["fast"] if None.
        notify: hears progress and warnings of all stages.
        resume: continue the stopped run in `out`; starts from the beginning where there is none.

    Raises:
        EngineError: `config.device` is cuda and does not work here.
        GocError: a subclass for each stage. What was in `out` is then as it was before.
    """
    config = config or PRESETS["fast"]
    check_completion(config.complete)
    run = RunRecord(notify)
    engine = choose_engine(config.device, run)
    used = replace(config, device=engine.name)
    with claim_output(out, config.export.overwrite, resume) as output:
        with run.stage("capture"):
            capture = given = load_capture(source, config.capture, run)
        train, _ = split_views(len(given), config.reconstruct.holdout_every)
        if given.has_metric_depth:
            with run.stage("align"):
                capture = align(given, config.align, train, run)
        with run.stage("ids"):
            capture, repair = repair_ids(capture, config.ids, config.segment, run)
        if given.has_metric_depth and not given.has_ids:
            with run.stage("segment"):
                capture = segment(capture, config.segment, run)
        if not given.has_metric_depth:
            with run.stage("priors"):
                capture = add_priors(capture, config.priors, run, train)
        with run.stage("reconstruct"):
            splats = reconstruct(capture, config.reconstruct, run, output.checkpoint, output.resumes, engine=engine)
        views = rendered_views(splats, capture, engine.device)
        if not capture.has_ids:  # nor metric depth: the splats' own depth has to do
            with run.stage("segment"):
                views, splats = _told_apart(views, splats, config.segment, engine.device, run)
        with run.stage("extract"):
            measured = measured_views(capture, views, run)
            views = measured.views
            scene = extract_scene(splats, views, config.extract, config.world, run, engine.device)
            scene = replace(scene, settings=as_json(used), metrics=scene.metrics | repair.metrics | measured.metrics)
        with run.stage("complete"):
            scene = complete_objects(scene, config.complete, run, working_device(config.device))
        with run.stage("export"):
            export_scene(output.staged, scene)
            write_overview(output.staged / OVERVIEW, scene, views, _title(source), config.export.overview_views, run)
        write_report(output.staged / REPORT, source, given, scene, run, used, measured.errors)
        output.publish()
    return scene


def _told_apart(
    views: Capture, splats: Reconstruction, config: SegmentConfig, device: torch.device, run: RunRecord
) -> tuple[Capture, Reconstruction]:
    """Views with ids found in the splats' depth, and the splats with the labels that these vote for."""
    views = segment(views, config, run)
    labels = vote_labels(splats.gaussians.to(device), views, list(range(len(views))), run)
    return views, replace(splats, labels=labels)


def _title(source: Path) -> str:
    """What to call a capture: its folder, and its file where that was named."""
    whole = source.resolve()
    return f"{whole.parent.name}/{whole.name}" if whole.suffix == ".json" else whole.name
