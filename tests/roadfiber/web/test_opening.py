"""The page is there before what it shows, and says why that cannot be shown."""

import subprocess
import sys
import threading
from contextlib import contextmanager

import numpy as np
from matplotlib.colors import to_rgb

from roadfiber.web.strain_maps import COLORS, palette
from tests.roadfiber.web.test_workbench_page import PATIENCE, opened
from vision.contract.drawing import color_map, color_scale

#: What a browser says once it has drawn a page.
READY = "document_ready"

SERVED = """
import sys, time
from pathlib import Path
import panel as pn
from roadfiber.web.opening import Opening
from roadfiber.web.server import serve
from vision.contract import InputError

pn.extension()
opening = Opening("Reading <i>it</i> ...")

def read():
    while not Path(sys.argv[1]).exists():
        time.sleep(0.05)
    if sys.argv[2] == "shown":
        return opening.ready(lambda: pn.pane.HTML("<p id='there'>there</p>"))
    opening.failed("data.npz: <b>none</b>")
    raise InputError("data.npz: none")

try:
    serve(opening.page, "test", port=0, browser=False, title="test", work=read)
except InputError as error:
    print(error)
"""


@contextmanager
def served(path, how):
    """The address of a page that waits for a file, and its process."""
    with subprocess.Popen([sys.executable, "-c", SERVED, path, how], stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process.stdout.readline().split()[1], process
        finally:
            process.terminate()


DRAWN = """
import sys
from pathlib import Path
from bokeh.document import Document
from roadfiber.web import bench
from roadfiber.web.film import film_of
from roadfiber.web.layout import laid_out
from roadfiber.web.workbench_page import Page
from solver.run.read_seen import read_seen
from tests.roadfiber.web.told import Told

bench.Worker = Told
run = read_seen(Path(sys.argv[1]))
document = Document()
document.add_root(laid_out(Page(bench.Bench(run), film_of(run))).get_root(document))
document.to_json()
print(len(document.roots), sorted({"torch", "scipy", "numba", "pandas", "matplotlib"} & set(sys.modules)))
"""


def test_a_run_is_drawn_before_what_takes_long_to_load(hidden):
    done = subprocess.run([sys.executable, "-c", DRAWN, hidden], capture_output=True, text=True, check=True)
    assert done.stdout == "1 []\n"


def test_the_colors_are_those_of_all_pages():
    limit, even = 40.0, np.linspace(-40, 40, COLORS)
    scale = color_map()(color_scale(np.array([limit]))(even))[:, :3]
    drawn = np.array([to_rgb(one) for one in palette(limit)])
    assert np.abs(drawn - scale).max() < 4 / 255


def test_the_page_waits_for_what_it_shows(chromium, tmp_path):
    with served(tmp_path / "go", "shown") as (address, _):
        page = opened(chromium, address)
        page.locator("#reading", has_text="Reading <i>it</i> ...").wait_for()
        (tmp_path / "go").touch()
        page.locator("#there").wait_for()
        later = opened(chromium, address)
        later.locator("#there").wait_for()
        page.close()
        later.close()


def test_the_page_says_why_there_is_nothing_to_show(chromium, tmp_path):
    with served(tmp_path / "go", "failed") as (address, process):
        page = opened(chromium, address)
        page.locator("#reading", has_text="Reading <i>it</i> ...").wait_for()
        (tmp_path / "go").touch()
        page.locator("#reading", has_text="data.npz: <b>none</b>").wait_for()
        page.locator("#roadfiber-lost").wait_for()
        assert process.communicate(timeout=60)[0] == "data.npz: none\n"
        page.close()


def test_what_is_ready_while_a_browser_still_loads_is_shown(chromium, tmp_path):
    """Between sending a page and hearing that it is drawn, a server of Panel sends no changes."""
    with served(tmp_path / "go", "shown") as (address, _):
        page = chromium.new_page()
        page.set_default_timeout(PATIENCE)
        held, drawn = [], threading.Event()

        def route(socket):
            server = socket.connect_to_server()

            def sent(frame):
                # What comes after it waits, too: a message is several frames.
                if not drawn.is_set() and (held or READY in frame):
                    held.append(frame)
                else:
                    server.send(frame)

            def draw():
                drawn.set()
                for frame in held:
                    server.send(frame)

            socket.on_message(sent)
            page.draw = draw

        page.route_web_socket("**/ws*", route)
        page.goto(address)
        page.locator("#reading").wait_for()
        (tmp_path / "go").touch()
        other = opened(chromium, address)
        other.locator("#there").wait_for()
        assert held
        page.draw()
        page.locator("#there").wait_for()
        page.close()
        other.close()
