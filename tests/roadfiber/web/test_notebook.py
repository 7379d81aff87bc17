"""The workbench in a notebook: a Panel object that renders without a server, and follows what happens on the bench."""

import panel as pn
import pytest
from bokeh.document import Document
from bokeh.models import Plot

import roadfiber as rf
from roadfiber.web import bench as module
from tests.roadfiber.web.told import Told


@pytest.fixture
def shown(hidden, monkeypatch):
    monkeypatch.setattr(module, "Worker", Told)
    return rf.open(hidden).workbench()


def test_it_renders_with_all_its_figures(shown):
    root = shown.get_root()
    names = {plot.name for plot in root.select({"type": Plot})}
    assert {"map", "depth", "measured", "model", "residual", "traces"} <= names
    document = Document()
    document.add_root(root)
    assert len(document.to_json(deferred=False)["roots"]) == 1


def test_it_is_what_a_notebook_shows(shown):
    assert isinstance(shown, pn.viewable.Viewable)
    words = [pane.object for pane in shown.select(pn.pane.HTML)]
    assert any("noise alone leaves" in text for text in words)
