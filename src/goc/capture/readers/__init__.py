"""One reader a format, chosen by what lies in a folder; FORMATS lists them in the order in which they are tried."""

from goc.capture.readers import (
    arkitscenes,
    colmap,
    nerfstudio,
    polycam,
    record3d,
    replica,
    rgbd,
    scanner_app,
    scannet,
    sens,
    tum,
)
from goc.capture.readers.reader import Reader

FORMATS: tuple[Reader, ...] = (
    record3d.READER,
    polycam.READER,
    scanner_app.READER,
    arkitscenes.READER,
    sens.READER,
    scannet.READER,
    replica.READER,
    tum.READER,
    nerfstudio.READER,
    colmap.READER,
    rgbd.READER,
)

__all__ = ["FORMATS", "Reader"]
