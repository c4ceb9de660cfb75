import os
import shutil

import pytest

from captures import write_nerfstudio


@pytest.fixture(scope="session")
def sound(tmp_path_factory):
    """A sound capture of 12 views of 64 x 48 pixels; not to be written into."""
    return write_nerfstudio(tmp_path_factory.mktemp("sound") / "capture", views=12)


@pytest.fixture
def capture(sound, tmp_path):
    """A copy to spoil; files are shared until they are replaced."""
    shutil.copytree(sound, tmp_path / "capture", copy_function=os.link)
    return tmp_path / "capture"
