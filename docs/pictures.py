"""Pictures of pages in README.md, drawn anew from two demos, and in the tutorial, from the run that it makes.

    roadfiber demo --laid crossing --out runs/demo
    roadfiber demo --hide any --out runs/demo-hidden
    python docs/pictures.py --demos runs/demo runs/demo-hidden
    python docs/pictures.py --tutorial run

Needs Playwright and a Chromium on the PATH; a picture is the page from its top to the end of a section, or one section,
in the light theme.
"""

import argparse
import shutil
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

IMAGES = Path(__file__).parent / "images"
#: Picture, which demo's, page, px of the window, px of the margin that is cut off at left and right, last
#: section, and whether it stands alone.
PICTURES = (
    ("report.png", 0, "run/report.html", 1011, 0, "Where the fiber is", True),
    ("diagnosis.png", 1, "run/diagnosis.html", 960, 16, "One vehicle, before and after", False),
    ("ladder.png", 1, "run-2/ladder.html", 960, 16, "What is left of one pass", False),
)
#: The same of the tutorial's run.
TUTORIAL = (
    ("tutorial_report.png", 0, "report.html", 1000, 0, "Where the fiber is", False),
    ("tutorial_diagnosis.png", 0, "diagnosis.html", 1000, 0, "How probable each explanation is", False),
)


def picture(page: Page, url: str, width: int, margin: int, last: str, alone: bool, out: Path) -> None:
    """One picture."""
    page.set_viewport_size({"width": width, "height": 900})
    page.goto(url)
    box = page.locator("section", has_text=last).first.bounding_box()
    assert box is not None, f"{url} has no section {last}"
    begin, end = (box["y"] - 16 if alone else 0), box["y"] + box["height"] + 16
    page.screenshot(
        path=out, full_page=True, clip={"x": margin, "y": begin, "width": width - 2 * margin, "height": end - begin}
    )


def street(page: Page, url: str, out: Path) -> None:
    """The camera's picture with the route drawn into it."""
    page.set_viewport_size({"width": 960, "height": 900})
    page.goto(url)
    page.locator("section", has_text="The fiber on the street").locator("svg").first.screenshot(path=out)


def main() -> None:
    """Draw all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--demos", type=Path, nargs=2, metavar=("DEMO", "HIDDEN"), default=())
    parser.add_argument("--tutorial", type=Path, metavar="RUN")
    options = parser.parse_args()
    pictures = [(one, options.demos) for one in PICTURES] if options.demos else []
    pictures += [(one, [options.tutorial]) for one in TUTORIAL] if options.tutorial else []
    chromium = next(path for name in ("chromium", "google-chrome") if (path := shutil.which(name)))
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
        page = browser.new_page(color_scheme="light")
        for (name, which, file, width, margin, last, alone), folders in pictures:
            picture(page, f"{folders[which].resolve().as_uri()}/{file}", width, margin, last, alone, IMAGES / name)
        if options.demos:
            street(page, f"{options.demos[0].resolve().as_uri()}/run/report.html", IMAGES / "street.png")
        browser.close()


if __name__ == "__main__":
    main()
