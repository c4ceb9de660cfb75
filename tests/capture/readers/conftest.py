"""A small room in the native layout, for readers of other formats."""

import pytest

from captures import write_nerfstudio
from goc.capture import load_capture


@pytest.fixture(scope="package")
def room(tmp_path_factory):
    """Folder of a room of twelve views with depth, ids and names."""
    return write_nerfstudio(tmp_path_factory.mktemp("room") / "native", 12)


@pytest.fixture(scope="package")
def truth(room):
    """The same as a capture."""
    return load_capture(room)
