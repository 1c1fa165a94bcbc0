"""What is released says one version everywhere, and hints name the command that fits how it was installed."""

import json
import re
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest

from mavlink_formation import installation
from wire.version import VERSION

ROOT = Path(__file__).parents[1]


def read(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("origin", "command"),
    [
        ({}, "pip install 'mavlink-formation[page]'"),
        ({"url": "file:///a.whl", "archive_info": {}}, "pip install 'mavlink-formation[page] @ file:///a.whl'"),
        (
            {"url": "https://host/it", "vcs_info": {"vcs": "git", "commit_id": "0a1b"}},
            "pip install 'mavlink-formation[page] @ git+https://host/it@0a1b'",
        ),
        (None, "pip install -e '.[page]' in {folder}"),
    ],
    ids=["index", "file", "repository", "clone"],
)
def test_a_hint_adds_to_what_is_installed(
    origin: dict[str, object] | None, command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(installation, "__file__", str(tmp_path / "mavlink_formation" / "installation.py"))
    if origin is None:
        (tmp_path / "pyproject.toml").touch()
    text = json.dumps(origin) if origin else None  # the index leaves no such file
    monkeypatch.setattr(installation, "distribution", lambda _name: SimpleNamespace(read_text=lambda _file: text))
    assert installation.install_command("page") == command.format(folder=tmp_path)


def test_no_hint_is_written_by_hand() -> None:
    by_hand = re.compile(r"""pip install '?(?:mavlink-formation\[|\.\[)(?!\{)""")
    sources = [path for name in tomllib.loads(read("pyproject.toml"))["tool"]["importlinter"]["root_packages"]
               for path in (ROOT / name).rglob("*.py")]  # fmt: skip
    assert len(sources) > 300
    code = {path: re.sub(r'""".*?"""', "", path.read_text(encoding="utf-8"), flags=re.DOTALL) for path in sources}
    assert [str(path) for path, text in code.items() if by_hand.search(text)] == []


def test_one_version_with_one_date() -> None:
    """Of the program, the changelog's newest release, and the citation."""
    version, date = re.findall(r"^## \[([\d.]+)\] - (\d{4}-\d\d-\d\d)$", read("CHANGELOG.md"), re.MULTILINE)[0]
    cited = dict(re.findall(r"^([\w-]+): \"?([^\"\n]+)\"?$", read("CITATION.cff"), re.MULTILINE))
    assert (version, cited["version"], cited["date-released"]) == (VERSION, VERSION, date)


def test_the_citation_names_the_paper_whose_law_flies() -> None:
    assert "10.3390/machines12010032" in read("CITATION.cff").partition("references:")[2]
