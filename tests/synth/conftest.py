import pytest

from goc.synth.captures import RoomConfig, make_room_capture
from goc.synth.lighting import bake
from goc.synth.room import furnish_room
from goc.synth.surfaces import gather_surfaces

CONFIG = RoomConfig(seed=2, views=8, width=64, height=48, samples=2)


@pytest.fixture(scope="session")
def demo_config():
    return CONFIG


@pytest.fixture(scope="session")
def room():
    return furnish_room(CONFIG.seed, CONFIG.objects)


@pytest.fixture(scope="session")
def surfaces(room):
    return gather_surfaces(room.shell, room.objects)


@pytest.fixture(scope="session")
def lit(room, surfaces):
    return bake(surfaces, room.lights, bounces=1, samples=2)


@pytest.fixture(scope="session")
def demo_capture(tmp_path_factory):
    """A small capture, and the events that were heard while it was made."""
    heard = []
    return make_room_capture(tmp_path_factory.mktemp("demo") / "capture", CONFIG, heard.append), heard
