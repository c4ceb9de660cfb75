"""Readers of what phones and RGB-D data sets record. They come before those of tools, whose files some of them hold."""

from goc.capture.readers import (
    arkitscenes,
    bop,
    holoscene,
    monosdf,
    polycam,
    record3d,
    replica,
    scanner_app,
    scannet,
    scannetpp,
    sens,
    seven_scenes,
    stray,
    tum,
)
from goc.capture.readers.reader import Reader

RECORDINGS: tuple[Reader, ...] = (
    record3d.READER,
    polycam.READER,
    stray.READER,
    scanner_app.READER,
    arkitscenes.READER,
    sens.READER,
    scannet.READER,
    scannetpp.READER,
    replica.READER,
    tum.READER,
    seven_scenes.READER,
    monosdf.READER,
    bop.READER,
    holoscene.READER,
)
