"""What color alone tells can be seen without red or green cones, and words stand out from what is behind them.

Color vision as Machado, Oliveira and Fernandes simulate it (2009, IEEE TVCG 15, 1291, severity 1.0), distances in CIE
Lab (Delta E 76), of which 2.3 are just noticed (Mahy, van Eycken and Oosterlinck 1994, Color Res. Appl. 19, 105);
contrast of words as WCAG 2.1 counts it, 4.5 at least (AA).
"""

import re
from importlib.resources import files
from itertools import combinations

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import to_hex

from calib.page_text import LEFT_OUT, UNPLACED, USED
from calib.page_text import STYLE as CALIBRATION
from roadfiber.web.figures import INK as PAGE_INK
from roadfiber.web.figures import MUTED as PAGE_MUTED
from roadfiber.web.server import LOST
from roadfiber.web.start_page import COLORS as VERDICTS
from roadfiber.web.words import STYLE as WORKBENCH
from solver.criticism.diagnosis_figures import FOUND_COLOR, OTHER_COLOR, UNKNOWN_COLOR
from solver.criticism.probability_figure import FIRST_COLOR, REST_COLOR
from solver.run.report.parts import resource
from vision.contract.figures import INK, MUTED
from vision.contract.palette import BACKWARD, FORWARD, ROUTE, SERIES
from vision.overlay import COLORS as BOXES
from vision.quality.drawing import CLASS_COLORS, class_color

MATRICES = {
    "all cones": np.eye(3),
    "no green cones": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "no red cones": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
}
TO_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
WHITE = np.array([0.95047, 1.0, 1.08883])
QUALITY = files("vision.quality").joinpath("template.html").read_text(encoding="utf-8")
FIVE_JUST_NOTICED = 5 * 2.3
READABLE = 4.5

DARK = "#e7eaed"  # text where a page is dark
GRADES = re.findall(r"\.(?:good|fair|weak|poor) { border-color: (#\w+);", resource("style.css"))
TOLD_BY_COLOR = {
    "route and vehicles both ways": (ROUTE, FORWARD, BACKWARD),
    "lines of a figure": SERIES,
    "classes of vehicles": (*CLASS_COLORS.values(), class_color("other")),
    "classes of vehicles, dark": (*CLASS_COLORS.values(), DARK),
    "boxes of tracks": [to_hex(np.array(one)[::-1] / 255) for one in BOXES],
    "marks of a calibration": (USED, LEFT_OUT, UNPLACED),
    "explanations": (FIRST_COLOR, OTHER_COLOR, REST_COLOR),
    "candidates": (FOUND_COLOR, OTHER_COLOR, UNKNOWN_COLOR),
    "grades": GRADES,
    "checks of a site": tuple(VERDICTS.values()),
    "traces": (PAGE_INK, PAGE_MUTED, ROUTE),
    "text of figures": (INK, MUTED, ROUTE),
    "ends and middle of the scale": [to_hex(matplotlib.colormaps["RdBu_r"](at)) for at in (0.1, 0.5, 0.9)],
}


def linear(color):
    """Linear red, green and blue of "#rrggbb" or "#rgb"."""
    digits = color[1:] if len(color) == 7 else "".join(2 * one for one in color[1:])
    value = np.array([int(digits[at : at + 2], 16) for at in (0, 2, 4)]) / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def lab(color, seen):
    """CIE Lab of a color as it is seen with some cones."""
    part = TO_XYZ @ np.clip(np.array(MATRICES[seen]) @ linear(color), 0, 1) / WHITE
    x, y, z = np.where(part > 216 / 24389, np.cbrt(part), (24389 / 27 * part + 16) / 116)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def contrast(one, other):
    low, high = sorted(float(TO_XYZ[1] @ linear(color)) for color in (one, other))
    return (high + 0.05) / (low + 0.05)


def variables(css):
    """Colors by name of each theme that a style sheet declares; the later ones change the first."""
    themes = [dict(re.findall(r"--(\w+): (#\w+)", text)) for text in re.findall(r":root { ([^}]*)}", css)]
    return [themes[0] | theme for theme in themes]


def test_what_is_measured_is_known():
    assert contrast("#000000", "#ffffff") == pytest.approx(21) and contrast("#777", "#fff") == pytest.approx(4.48, 0.01)
    assert lab("#ff0000", "all cones") == pytest.approx([53.24, 80.09, 67.20], abs=0.05)
    green_and_red = [lab(one, "no green cones") for one in ("#2ca02c", "#d62728")]
    assert np.linalg.norm(np.subtract(*green_and_red)) < FIVE_JUST_NOTICED, "what many programs draw"


@pytest.mark.parametrize("seen", MATRICES)
@pytest.mark.parametrize("colors", TOLD_BY_COLOR.values(), ids=TOLD_BY_COLOR)
def test_colors_that_tell_something_apart_are_apart_for_all_eyes(colors, seen):
    assert len(colors) > 2
    for one, other in combinations(colors, 2):
        assert np.linalg.norm(lab(one, seen) - lab(other, seen)) > FIVE_JUST_NOTICED, (one, other)


@pytest.mark.parametrize("css", [resource("style.css"), QUALITY], ids=["pages", "quality"])
def test_words_of_pages_are_readable_light_dark_and_printed(css):
    themes = variables(css)
    assert len(themes) == 3
    for theme in themes:
        words = {"ink", "muted", "link", "use"} & set(theme)
        for name in words:
            for behind in ("paper", "ground"):
                assert contrast(theme[name], theme[behind]) >= READABLE, (name, behind, theme[name], theme[behind])
    colored = re.findall(r"[{; ]color: ([^;]+);", css.partition("</style>")[0])
    assert set(colored) <= {f"var(--{name})" for name in ("ink", "muted", "link", "use")}, "in no other color"


@pytest.mark.parametrize("css", [WORKBENCH, CALIBRATION], ids=["workbench", "calibration"])
def test_words_of_served_pages_are_readable(css):
    words = re.findall(r"[{; ]color: (#\w+)", css)
    assert len(words) >= 2 and all(contrast(one, "#ffffff") >= READABLE for one in words)
    behind = re.search(r"background:(#\w+);color:white", LOST)[1]
    assert contrast("#ffffff", behind) >= READABLE
