"""goc, the Gaussian Object Carver: photographs of a room in, separate simulator-ready objects out."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("goc")
except PackageNotFoundError:  # run from a source tree that was never installed
    __version__ = "0+source"
