"""One reader a format, chosen by what lies in a folder; FORMATS lists them in the order in which they are tried."""

from goc.capture.readers import colmap, metashape, nerfstudio, realitycapture, rgbd
from goc.capture.readers.reader import Reader
from goc.capture.readers.recordings import RECORDINGS

FORMATS: tuple[Reader, ...] = (
    *RECORDINGS,
    nerfstudio.READER,
    colmap.READER,
    rgbd.READER,
    metashape.READER,
    realitycapture.READER,
)

__all__ = ["FORMATS", "RECORDINGS", "Reader"]
