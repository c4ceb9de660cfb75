"""One reader a format, chosen by what lies in a folder; FORMATS lists them in the order in which they are tried."""

from goc.capture.readers import colmap, metashape, nerfstudio, realitycapture, rgbd
from goc.capture.readers.reader import Reader

FORMATS: tuple[Reader, ...] = (
    nerfstudio.READER,
    colmap.READER,
    rgbd.READER,
    metashape.READER,
    realitycapture.READER,
)

__all__ = ["FORMATS", "Reader"]
