"""The built manual in a real browser: no page is wider than the window, on a telephone or a wide screen."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.manual_pages import MANUAL
from tests.gcs.page.browser import CHROMIUM, NONE, browser

WIDTHS_PX = (390, 768, 1100, 1280, 1440, 1920)


@pytest.mark.processes
@pytest.mark.skipif(CHROMIUM is None, reason=NONE)
def test_no_page_scrolls_sideways(tmp_path: Path) -> None:
    built = tmp_path / "html"
    command = [sys.executable, "-m", "sphinx", "-q", "-b", "html", str(MANUAL), str(built)]
    subprocess.run(command, check=True, capture_output=True)
    pages = [page for page in sorted(built.rglob("*.html")) if page.name not in ("genindex.html", "search.html")]
    assert len(pages) > 50
    wide = []
    with browser(tmp_path) as new_tab:
        tab = new_tab()
        for page in pages:
            tab.open(page.as_uri())
            tab.until(f"location.href === '{page.as_uri()}' && document.readyState === 'complete'")
            for width_px in WIDTHS_PX:
                tab.resize(width_px)
                # A flex item that scrolls hides what is too wide as well as a page does.
                over = tab.run(
                    "[document.documentElement, document.querySelector('.content')]"
                    ".some(e => e && e.scrollWidth > Math.min(e.clientWidth, innerWidth))"
                )
                wide += [f"{page.relative_to(built)} at {width_px} px"] if over else []
    assert wide == []
