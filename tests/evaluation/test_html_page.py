"""The page and its pictures."""

import base64
import io
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image

from goc.evaluation import evaluate, write_evaluation
from goc.evaluation.error_maps import RAMP, colours_of_distance, worst_error_maps, worst_objects
from goc.evaluation.html_page import page
from goc.evaluation.metric_format import METRICS, summary_sentence, table_columns
from solids import moved
from truths import CRATE, write_run, write_truth


class Tags(HTMLParser):
    """Checks that tags close in order, and collects what a browser would fetch."""

    def __init__(self):
        super().__init__()
        self.open, self.fetched, self.names = [], [], set()

    def handle_starttag(self, tag, attrs):
        self.names.add(tag)
        self.fetched += [value for name, value in attrs if name in ("src", "href")]
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def evaluated(tmp_path_factory):
    truth = write_truth(tmp_path_factory.mktemp("room"))
    (truth / "labels.json").write_text('{"1": "<b>crate & co</b>", "2": "cupboard"}')
    run = write_run(tmp_path_factory.mktemp("run"), {1: moved(CRATE, (0, 0, 0.02)), 9: CRATE})
    return evaluate(run, truth), run, truth


def test_the_page_is_whole_and_fetches_nothing(evaluated, tmp_path, monkeypatch):
    monkeypatch.setattr("goc.evaluation.error_maps._SIZE", 32)
    found, _, _ = evaluated
    write_evaluation(found, tmp_path)
    text = (tmp_path / "eval.html").read_text()
    tags = Tags()
    tags.feed(text)
    assert tags.open == [] and "script" not in tags.names and "link" not in tags.names
    assert len(tags.fetched) == 3 + 6 and all(uri.startswith("data:image/png;base64,") for uri in tags.fetched)
    assert "&lt;b&gt;crate &amp; co&lt;/b&gt;" in text and "<b>crate" not in text
    assert "Nothing was predicted" in text and "missing: 2" in text and "Extra: 9" in text
    first = Image.open(io.BytesIO(base64.b64decode(re.findall(r"base64,([^\"]+)", text)[0])))
    assert first.size == (32, 32)


def test_a_page_without_pictures_has_no_gallery(evaluated):
    assert "Worst objects" not in page(evaluated[0], "run", [])


def test_the_worst_come_first_and_a_missing_one_before_all(evaluated):
    found, run, truth = evaluated
    assert worst_objects(found, 5) == [2, 1]
    assert [item.id for item in worst_error_maps(found, run, truth, 0)] == []


def test_pictures_show_how_far_off_a_surface_is(evaluated, monkeypatch):
    monkeypatch.setattr("goc.evaluation.error_maps._SIZE", 48)
    found, run, truth = evaluated
    shown = worst_error_maps(found, run, truth, 2)[1]
    lid = np.array(Image.open(io.BytesIO(base64.b64decode(shown.prediction[0].split(",")[1]))))[18:22, 22:26]
    red, _, blue = lid.reshape(-1, 3).mean(axis=0)
    assert red > blue + 20  # lifted by 2 cm: warm


def test_colours_run_from_cool_to_dark():
    colours = colours_of_distance(np.array([0.0, 0.008, 0.02, 0.2]))
    np.testing.assert_allclose(colours[[0, 3]], [RAMP[0][1], RAMP[-1][1]])
    assert colours[1][2] > colours[1][0] and colours[2][0] > colours[2][2]


def test_every_figure_has_words_and_columns_only_where_it_says_something(evaluated):
    found = evaluated[0]
    assert set(found.mean) <= set(METRICS) and {k for o in found.objects.values() for k in o.figures} <= set(METRICS)
    columns = table_columns(found)
    assert "iou" in columns and "precision_0.05" not in columns and "volume" not in columns
    assert summary_sentence(found) == (
        "1 of 2 objects found; missing: 2; 1 extra; 1 watertight; "
        "deepest into others 0.0 mm; deepest into room 0.0 mm; deepest bottom 20.0 mm."
    )
    assert evaluate(evaluated[1], evaluated[2], matching="shape").objects[1].predicted == 9
    assert METRICS["accuracy"].shown(0.0123) == "12.3" and METRICS["iou"].shown(None) == "–"
