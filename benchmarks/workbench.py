"""The workbench in a browser: how long it takes to open, and from a key on the slider of sizes to the residual.

    python -m benchmarks.workbench
    python -m benchmarks.workbench --run runs/demo-hidden/run
    python -m benchmarks.workbench --kilometers 10.3 --passes 4

The run is of 251 channels and 10 vehicles, simulated with gauges longer than told, of which the camera sees 170 m; with
`--kilometers` of a long fiber (10.3 km are 10,088 channels), on which nothing is previewed; or any run folder.

- opening: from the command to eight figures drawn in Chromium; and the server's CPU (user and system) by then
- preview: the first candidate is chosen and prepared, then the slider moved by one step of a key, `--moves` times:
  until misfit and residual of that size are drawn. After a rest of 1.5 s, in which all else comes nearer to where it
  fits; and every half second, while that goes on.
- wheel: on any run, from a turn of the wheel over the residual to its part drawn

Seconds are those of the machine as it is: the load (processes that ran or waited, mean of a minute) is told beside
them; with more than one process a core they measure the others, too. Needs Playwright and a Chromium on the PATH.
"""

import argparse
import os
import re
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import roadfiber as rf
from benchmarks.long_fiber import made, written
from solver.run.read_seen import read_seen

STREET: dict[str, Any] = {"channels": 251, "view": (0.0, 170.0), "passes": 10, "seed": 3}
FIGURES = 8
FIND = """
    const all = (wanted, root = document) => [...root.querySelectorAll('*')].flatMap(
        one => [...(one.matches(wanted) ? [one] : []), ...(one.shadowRoot ? all(wanted, one.shadowRoot) : [])])
"""
#: Notes when the residual that is drawn has changed, and which size the page tells by then; and when a key or the wheel
#: was moved.
NOTE = f"""() => {{ {FIND}
    const drawn = Bokeh.documents[0].get_model_by_name('residual').renderers[0].data_source
    window.noted = []
    drawn.properties.data.change.connect(() => requestAnimationFrame(() => requestAnimationFrame(() =>
        window.noted.push([performance.now(), all('#expected')[0]?.dataset.size || '']))))
    for (const kind of ['keydown', 'wheel'])
        document.addEventListener(kind, () => {{ window.moved = performance.now() }}, true)
}}"""
#: Middle of the residual on the page.
MIDDLE = """() => {
    const drawn = Bokeh.documents[0].get_model_by_name('residual')
    const at = Bokeh.index.find_one(drawn).el.getBoundingClientRect()
    return [at.x + at.width / 2, at.y + at.height / 2]
}"""


def run_of(options: argparse.Namespace, folder: Path) -> Path:
    """The run folder that is asked for."""
    if options.run:
        return Path(options.run)
    if options.kilometers:
        site = written(made(options.kilometers, options.passes, 15.0, 1), folder / "survey")
    else:
        site = rf.simulate(folder / "survey", "street", effects={"gauge_length": 0.15}, **STREET).site
    rf.locate(site, corridor="fit").save(folder / "run")
    return folder / "run"


@contextmanager
def served(run: Path) -> Iterator[tuple[str, int]]:
    """The address of the workbench of a run, and its process."""
    words = [sys.executable, "-m", "roadfiber", "workbench", str(run), "--no-browser"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            found = re.search(r"http://\S+", process.stdout.readline())
            assert found is not None, "it printed no address"
            yield found[0], process.pid
        finally:
            process.send_signal(signal.SIGINT)


def cpu_of(process: int) -> float:
    """CPU of a process so far, s; Linux tells it in hundredths."""
    words = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def opened(browser: Any, run: Path) -> Iterator[tuple[Any, float, float]]:
    """The page of a workbench, and what it took: s, and CPU s of the server."""
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    page.set_default_timeout(600_000)
    begun = time.perf_counter()
    with served(run) as (address, process):
        page.goto(address, wait_until="commit")
        page.wait_for_function(f"() => {{ {FIND}; return all('canvas').length >= {FIGURES} }}", polling=30)
        yield page, time.perf_counter() - begun, cpu_of(process)
        page.close()


def told(name: str, milliseconds: list[float]) -> None:
    """Print the median and the worst."""
    middle, worst = statistics.median(milliseconds), max(milliseconds)
    print(f"{name}: median {middle:.0f} ms, worst {worst:.0f} ms of {len(milliseconds)}; {load()}", flush=True)


def load() -> str:
    """How busy the machine is."""
    return f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"


def prepared(page: Any) -> None:
    """Choose the first candidate, and wait until its size can be moved."""
    effects = page.get_by_label(re.compile("What may be missing"))
    effects.locator("option").first.wait_for(state="attached")
    effects.select_option(index=0)
    page.get_by_text(re.compile("fits best near")).wait_for()
    page.get_by_role("slider").first.focus()


def previewed(page: Any, rest: float) -> float:
    """From a key to the residual of the new size, ms; after it nothing is moved for some seconds."""
    before = page.evaluate(f"() => {{ {FIND}; return all('#expected')[0]?.dataset.size || '' }}")
    page.evaluate("() => { window.noted = [] }")
    page.keyboard.press("ArrowRight")
    page.wait_for_function(f"() => window.noted.some(one => one[1] !== '{before}')", polling=10)
    took: float = page.evaluate(f"() => window.noted.find(one => one[1] !== '{before}')[0] - window.moved")
    page.wait_for_timeout(1000 * rest)
    return took


def zoomed(page: Any) -> float:
    """From a turn of the wheel over the residual to its part drawn, ms."""
    page.evaluate("() => { window.noted = [] }")
    page.mouse.wheel(0, -120)
    page.wait_for_function("() => window.noted.length > 0", polling=10)
    took: float = page.evaluate("() => window.noted[0][0] - window.moved")
    page.wait_for_timeout(1000)
    return took


def measure(browser: Any, run: Path, options: argparse.Namespace) -> None:
    """Open the workbench some times, and move what can be moved the last time."""
    shown = read_seen(run)
    print(f"{len(shown.result.fitted_channel)} channels fitted, {len(shown.passes)} vehicles; {load()}", flush=True)
    for time_of in range(options.times):
        for page, seconds, cpu in opened(browser, run):
            print(f"opened in {seconds:.2f} s; CPU of the server {cpu:.2f} s; {load()}", flush=True)
            if time_of < options.times - 1:
                continue
            page.evaluate(NOTE)
            if not shown.too_long:
                prepared(page)
                told("preview, at rest", [previewed(page, 1.5) for _ in range(options.moves)])
                told("preview, every half second", [previewed(page, 0.5) for _ in range(options.moves)])
            box = page.evaluate(MIDDLE)
            page.mouse.move(*box)
            page.wait_for_timeout(1000)
            told("wheel", [zoomed(page) for _ in range(5)])


def main() -> None:
    """Make the run, and measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--run", type=Path, help="a run folder")
    parser.add_argument("--kilometers", type=float, default=0.0, help="of a long fiber")
    parser.add_argument("--passes", type=int, default=4, help="on the long fiber")
    parser.add_argument("--times", type=int, default=3, help="that it is opened")
    parser.add_argument("--moves", type=int, default=20)
    options = parser.parse_args()
    from playwright.sync_api import sync_playwright

    chromium = next(path for name in ("chromium", "google-chrome") if (path := shutil.which(name)))
    with tempfile.TemporaryDirectory() as temporary, sync_playwright() as driver:
        run = run_of(options, Path(temporary))
        browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
        measure(browser, run, options)


if __name__ == "__main__":
    main()
