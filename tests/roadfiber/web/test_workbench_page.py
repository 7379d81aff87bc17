"""The workbench in a real browser: read a failing region, try the first candidate, add it, undo, export."""

import json
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.web_requests import is_shut

READY = "window.Bokeh && Bokeh.documents.length > 0 && Bokeh.documents[0].is_idle"
PATIENCE = 150_000  # ms; tests share the machine

#: Finds an element within all shadow roots.
FIND = """
    const find = (wanted, root = document) => {
        const here = root.querySelector(wanted)
        if (here) return here
        for (const one of root.querySelectorAll('*')) {
            const there = one.shadowRoot && find(wanted, one.shadowRoot)
            if (there) return there
        }
        return null
    };
"""


#: An effect that is computed only once a file is gone: a diagnosis lasts as long as the test needs it.
WAITING = """
import time
from pathlib import Path

from roadfiber import Parameter, effect


@effect("downforce", "load", [Parameter("share", "1", 0.05)], physics="Air presses on a vehicle.", source="Hucho 1998.")
def downforce(load, p, survey):
    while Path({held!r}).exists():
        time.sleep(0.05)
    factor = 1 + p["share"] * (load.trajectory.speed / 30) ** 2
    return load.modulated(factor, 0 * factor)
"""


@pytest.fixture
def held(tmp_path):
    """A file; while it is there, no diagnosis ends."""
    return tmp_path / "held"


@pytest.fixture
def server(hidden, held, tmp_path):
    """The address that `roadfiber workbench` prints, and its process."""
    plugin = tmp_path / "waiting.py"
    plugin.write_text(WAITING.format(held=str(held)))
    words = [sys.executable, "-m", "roadfiber", "workbench", str(hidden), "--plugin", str(plugin), "--no-browser"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield re.search(r"http://\S+", process.stdout.readline())[0], process
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(30)


def opened(chromium, address):
    """The page of a browser, ready; what it asked for is kept."""
    page = chromium.new_page(viewport={"width": 1280, "height": 900})
    page.asked = []
    page.on("request", lambda request: page.asked.append(request.url))
    page.errors = []
    page.on("pageerror", lambda error: page.errors.append(str(error)))
    page.set_default_timeout(PATIENCE)
    page.goto(address)
    page.wait_for_function(READY)
    return page


def files_of(folder):
    """Names and contents of all files in a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_missing_effect_is_found_by_eye_tried_added_and_undone(chromium, server, hidden, held):
    address, process = server
    assert is_shut(address)
    page, other = opened(chromium, address), opened(chromium, address)

    regions = page.get_by_label("Where the model fails")
    regions.locator("option").first.wait_for(state="attached")
    regions.select_option(index=0)
    page.locator("p", has_text=re.compile("^(all passes|channel)")).first.wait_for()
    effects = page.get_by_label(re.compile("What may be missing"))
    effects.locator("option", has_text="1. Gauge length").wait_for(state="attached")
    effects.select_option(index=0)
    page.get_by_text(re.compile("fits best near")).wait_for()
    handle = page.get_by_role("slider").first
    handle.focus()
    for _ in range(20):  # by the keyboard alone
        handle.press("ArrowRight")
    before = float(page.locator("#misfit", has_text=re.compile("[0-9]")).inner_text())
    page.wait_for_function(f"() => {{{FIND} return Number(find('#expected')?.textContent) < {before} - 0.05}}")
    assert page.evaluate("() => document.documentElement.scrollWidth") <= 1280
    assert page.locator("#injected").count() == 0 and page.get_by_text("<i id='injected'>").count() > 0
    assert all(url.startswith(("http://localhost:", "data:", "blob:")) for url in page.asked)

    page.get_by_role("button", name="Add to the model").click()
    page.locator("#said", has_text="added: gauge length").wait_for()
    rungs = json.loads((hidden.parent / "run-2" / "ladder.json").read_text())["rungs"]
    first, second = (one["chi2_per_dof"] for one in rungs)
    assert before == pytest.approx(first, abs=5e-4) and second < first - 0.3
    page.locator("#misfit", has_text=f"{second:.3f}").wait_for()
    for rung in rungs:
        page.get_by_text(f"misfit {rung['chi2_per_dof']:.3f}, held out {rung['held_out_chi2_per_dof']:.3f}").wait_for()
    other.locator("#said", has_text="added: gauge length").wait_for()
    page.get_by_role("button", name="Undo").click()
    page.locator("#said", has_text="back to the rung below").wait_for()
    page.locator("#misfit", has_text=f"{first:.3f}").wait_for()
    page.get_by_role("button", name="Redo").click()
    page.locator("#misfit", has_text=f"{second:.3f}").wait_for()
    with page.expect_download() as downloaded:
        page.get_by_text("Export route.geojson").click()
    exported = Path(downloaded.value.path()).read_bytes()
    assert exported == (hidden.parent / "run-2" / "route.geojson").read_bytes()

    held.touch()
    page.get_by_role("button", name="Diagnose").click()
    page.get_by_role("button", name="Cancel").click()
    page.locator("#said", has_text="diagnosing: canceled").wait_for()
    there = files_of(hidden.parent)
    page.get_by_role("button", name="Diagnose").click()
    page.locator("b", has_text="diagnosing").wait_for()
    process.send_signal(signal.SIGINT)
    page.locator("#roadfiber-lost", has_text="a fit that was under way is discarded").wait_for()
    assert process.wait(60) == 0 and files_of(hidden.parent) == there
    assert page.errors == other.errors == []
    page.close()
    other.close()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda run: (run / "data.npz").unlink(), "data.npz"),
        (lambda run: (run / "fit.json").write_text('{"format": "roadfiber run 1"}'), "written by an older roadfiber"),
    ],
)
def test_a_run_that_cannot_be_read_is_one_line(hidden, tmp_path, change, said):
    shutil.copytree(hidden, tmp_path / "run")
    change(tmp_path / "run")
    words = [sys.executable, "-m", "roadfiber", "workbench", str(tmp_path / "run"), "--no-browser"]
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    assert ended.returncode == 2 and ended.stderr.count("\n") == 1 and said in ended.stderr
