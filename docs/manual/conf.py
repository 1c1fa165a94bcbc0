"""Sphinx's configuration of the manual: MyST pages and the furo theme. `make reference` writes what is generated."""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(HERE / "_ext"), str(ROOT)]

import manual_math  # noqa: E402
from sphinx.application import Sphinx  # noqa: E402

from wire.version import VERSION  # noqa: E402

project = "mavlink-formation"
author = "The mavlink-formation authors"
release = version = VERSION

extensions = ["myst_parser"]
html_math_renderer = "mathml"
exclude_patterns = ["_build"]
myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath", "tasklist"]
myst_heading_anchors = 4
suppress_warnings = ["misc.highlighting_failure"]

html_theme = "furo"
html_title = f"mavlink-formation {VERSION}"
html_static_path = ["_static"]
html_css_files = ["manual.css"]
html_theme_options = {"navigation_with_keys": True}


def setup(app: Sphinx) -> dict[str, bool]:
    """Show equations as MathML."""
    app.add_html_math_renderer("mathml", (manual_math.inline, None), (manual_math.displayed, None))
    return {"parallel_read_safe": True}
