"""Exporters of what phones and RGB-D data sets record."""

from goc.synth.export import arkitscenes, polycam, record3d, replica, scanner_app, scannet, tum
from goc.synth.export.exporter import Exporter

RECORDINGS: tuple[Exporter, ...] = (
    polycam.EXPORTER,
    record3d.EXPORTER,
    scanner_app.EXPORTER,
    arkitscenes.EXPORTER,
    scannet.EXPORTER,
    scannet.SENS,
    replica.EXPORTER,
    replica.VMAP,
    tum.EXPORTER,
)
