"""One reader a format, chosen by what lies in a folder; FORMATS lists them in the order in which they are tried."""

from goc.capture.readers import nerfstudio, replica, rgbd, scannet, sens, tum
from goc.capture.readers.reader import Reader

FORMATS: tuple[Reader, ...] = (
    sens.READER,
    scannet.READER,
    replica.READER,
    tum.READER,
    nerfstudio.READER,
    rgbd.READER,
)

__all__ = ["FORMATS", "Reader"]
