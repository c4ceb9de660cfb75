"""Exporters of what phones and RGB-D data sets record."""

from goc.synth.export import (
    arkitscenes,
    bop,
    gaussian_grouping,
    holoscene,
    monosdf,
    polycam,
    record3d,
    replica,
    scanner_app,
    scannet,
    scannetpp,
    seven_scenes,
    stray,
    tum,
)
from goc.synth.export.exporter import Exporter

RECORDINGS: tuple[Exporter, ...] = (
    polycam.EXPORTER,
    record3d.EXPORTER,
    stray.EXPORTER,
    scanner_app.EXPORTER,
    arkitscenes.EXPORTER,
    scannet.EXPORTER,
    scannet.SENS,
    scannetpp.EXPORTER,
    replica.EXPORTER,
    replica.VMAP,
    tum.EXPORTER,
    seven_scenes.EXPORTER,
    monosdf.EXPORTER,
    bop.EXPORTER,
    holoscene.EXPORTER,
    gaussian_grouping.EXPORTER,
)
