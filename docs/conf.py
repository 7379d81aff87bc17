"""How the documentation is built: `make docs`, with warnings as errors."""

import sys
from importlib.metadata import version as installed
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE / "_ext")]

project = "roadfiber"
author = "the authors of roadfiber"
version = release = installed("roadfiber")
extensions = [
    "plain_docstrings",
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.viewcode",
    "numpydoc",
    "offline_math",
    "schema_tables",
    "command_reference",
]
exclude_patterns = ["_build", "_ext"]
nitpicky = True
nitpick_ignore_regex = [("py:.*", r"(?!roadfiber\.|solver\.|vision\.|calib\.).*")]
default_role = "code"
language = "en"

# Notebooks are kept executed; the tests run them.
nb_execution_mode = "off"
nb_merge_streams = True
myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
suppress_warnings = ["mystnb.unknown_mime_type"]

autodoc_typehints = "none"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
numpydoc_xref_param_type = False

html_theme = "furo"
html_title = f"roadfiber {release}"
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["roadfiber.css"]
html_copy_source = False
html_show_sphinx = False
