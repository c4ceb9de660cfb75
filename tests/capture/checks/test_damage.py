"""Whatever is wrong with a capture is named in one line with a remedy; nothing wrong is read in silence."""

import re

import pytest

from damagekinds import KINDS
from goc.capture import load_capture
from goc.errors import CaptureError, FileError


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_damage_is_named(capture, kind):
    kind.spoil(capture)
    heard = []
    if not kind.refused:
        load_capture(capture, notify=heard.append)
        assert any(re.search(kind.says, event.message) for event in heard), heard
        return
    with pytest.raises((CaptureError, FileError), match=kind.says) as raised:
        load_capture(capture, notify=heard.append)
    assert "\n" not in str(raised.value)


def test_the_sound_capture_is_not_doubted(capture):
    heard = []
    load_capture(capture, notify=heard.append)
    assert heard == []
