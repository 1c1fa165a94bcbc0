"""The release and the commit it was made from."""

import re

from wire import version


def test_text_names_release_and_commit():
    assert re.fullmatch(rf"mavlink-formation {version.VERSION}, commit ([0-9a-f]{{12,}}\+?|unknown)", version.text())
