"""The documentation builds with warnings as errors, opens offline, and no link of it leads nowhere."""

import re
import warnings
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from html.parser import HTMLParser
from io import StringIO
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import pytest

ROOT = Path(__file__).parents[1]


class Page(HTMLParser):
    """Places and links of a page, and what it loads."""

    def __init__(self, path: Path):
        super().__init__()
        self.places, self.links, self.loads = set[str](), list[str](), list[str]()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        known = {name: value or "" for name, value in attrs}
        self.places |= {known.get("id", ""), known.get("name", "")}
        if tag == "a" and "href" in known:
            self.links.append(known["href"])
        elif tag in ("script", "img", "iframe") and known.get("src"):
            self.loads.append(known["src"])
        elif tag == "link" and known.get("rel") in ("stylesheet", "icon"):
            self.loads.append(known["href"])


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("sphinx", reason="the extra roadfiber[docs] is not installed")
    out = tmp_path_factory.mktemp("docs")
    from sphinx.cmd.build import build_main

    # In this process, in which most of what it describes is loaded.
    told = StringIO()
    with warnings.catch_warnings(), redirect_stdout(told), redirect_stderr(told):
        warnings.simplefilter("ignore")  # of Sphinx about itself; its warnings of the pages are errors by -W
        status = build_main(["-q", "-n", "-W", "--keep-going", str(ROOT / "docs"), str(out)])
    assert status == 0, told.getvalue()
    return out


@pytest.fixture(scope="module")
def pages(built: Path) -> dict[Path, Page]:
    return {path: Page(path) for path in built.rglob("*.html")}


def targets(pages: dict[Path, Page]) -> Iterator[tuple[Path, str, Path, str]]:
    """Page, link, file and place of each link inside the documentation."""
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if not parts.scheme and not parts.netloc:
                file = (path.parent / unquote(parts.path)).resolve() if parts.path else path
                yield path, link, file, unquote(parts.fragment)


def test_every_link_leads_to_a_page_and_a_place_on_it(pages: dict[Path, Page]) -> None:
    assert len(pages) > 30
    wrong = list[str]()
    for path, link, file, place in targets(pages):
        if not file.is_file() or (place and file in pages and place not in pages[file].places):
            wrong.append(f"{path.name}: {link}")
    assert not wrong


def test_a_page_needs_no_network(built: Path, pages: dict[Path, Page]) -> None:
    assert not [load for page in pages.values() for load in page.loads if urlsplit(load).netloc]
    for style in built.rglob("*.css"):
        assert not re.findall(r"(?:@import|url\()\s*['\"]?https?:", style.read_text(encoding="utf-8")), style


def test_formulas_are_there_without_a_script(built: Path) -> None:
    text = (built / "mathematics" / "signal_path.html").read_text(encoding="utf-8")
    assert text.count("<math") > 20 and "MathJax" not in text


def test_a_fraction_takes_its_digits_one_by_one(built: Path) -> None:
    """`\\tfrac12 \\ln` was drawn as 12 over ln."""
    text = (built / "mathematics" / "criticism.html").read_text(encoding="utf-8")
    half = r"<mfrac[^>]*><mn>1</mn><mn>2</mn></mfrac>"
    assert len(re.findall(half, text)) == 4 and "<mn>12</mn>" not in text


@pytest.mark.parametrize("width", [390, 1280])
def test_no_code_on_the_first_page_is_cut(built: Path, chromium: Any, width: int) -> None:
    page = chromium.new_page(viewport={"width": width, "height": 900})
    page.goto((built / "index.html").as_uri())
    cut = "pres => pres.filter(pre => pre.scrollWidth > pre.clientWidth).map(pre => pre.innerText)"
    assert page.eval_on_selector_all("pre", cut) == []
    page.close()


def test_every_public_name_is_on_one_page_of_the_reference(built: Path) -> None:
    import roadfiber as rf

    shown = [Page(path).places for path in (built / "reference" / "python").glob("*.html")]
    assert {name: sum(f"roadfiber.{name}" in places for places in shown) for name in rf.__all__} == dict.fromkeys(
        rf.__all__, 1
    )


def test_every_command_is_in_the_reference(built: Path) -> None:
    from typer.main import get_command

    from roadfiber.command import app

    places = Page(built / "reference" / "commands.html").places
    assert [
        name for name in get_command(app).commands if not any(p.startswith(f"roadfiber-{name}") for p in places)
    ] == []
