"""Writes a synthetic room in the formats that goc reads: one small file a format, listed in EXPORTERS."""

from goc.synth.export.export import EXPORTERS, export_room
from goc.synth.export.exporter import Exporter

__all__ = ["EXPORTERS", "Exporter", "export_room"]
