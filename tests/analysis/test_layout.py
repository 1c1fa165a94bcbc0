"""Layouts: every path they plot is a field of a channel that a log has."""

import json
from pathlib import Path

import pytest
from google.protobuf import descriptor_pb2
from mcap.reader import make_reader
from typer.testing import CliRunner

from analysis.cli import app
from tests.analysis.synthetic_flight import LAB, METADATA
from wire.config_file import dump
from wire.logs.mcap_write import LogWriter


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("layout") / "flight.mcap"
    LogWriter(path, METADATA, threaded=False).close()
    return path


def fields_of(path: Path) -> set[str]:
    """`/drone/left/state.pos.y` of every channel, by its own descriptor."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    found = set()
    for channel in summary.channels.values():
        schema = summary.schemas[channel.schema_id]
        for proto in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
            for message in proto.message_type:
                if schema.name != f"{proto.package}.{message.name}":
                    continue
                nested = {f".{schema.name}.{one.name}": one for one in message.nested_type}
                for field in message.field:
                    parts = (
                        [f".{part.name}" for part in nested[field.type_name].field]
                        if field.type_name in nested
                        else [""]
                    )
                    found |= {f"{channel.topic}.{field.name}{part}" for part in parts}
    return found


def test_every_path_of_the_foxglove_layout_is_in_the_log(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "layout.json"
    done = CliRunner().invoke(app, ["layout", str(log), "--out", str(out)])
    assert done.exit_code == 0, done.output
    layout = json.loads(out.read_text())
    plotted = {path["value"] for panel in layout["configById"].values() for path in panel.get("paths", ())}
    assert "/drone/left/state.err.x" in plotted
    assert plotted <= fields_of(log)
    named = set(json.dumps(layout["layout"]).split('"'))
    assert set(layout["configById"]) <= named
    lab = tmp_path / "lab.toml"
    lab.write_text(dump(LAB))
    assert CliRunner().invoke(app, ["layout", str(lab), "--out", str(out)]).exit_code == 0
    assert json.loads(out.read_text()) == layout


@pytest.mark.parametrize(
    ("words", "why"),
    [(["FLIGHT", "--out", "layout.xml"], ".json (Foxglove) nor .rbl (Rerun)"), (["--out", "x.rbl"], "is of a log")],
)
def test_another_kind_of_file_is_refused(log: Path, tmp_path: Path, words: list[str], why: str) -> None:
    given = [str(log) if word == "FLIGHT" else word for word in words[:-1]]
    refused = CliRunner().invoke(app, ["layout", *given, str(tmp_path / words[-1])])
    assert (refused.exit_code, why in refused.stderr) == (2, True)


PUBLISHED = {
    "Plot": "paths title showLegend legendDisplay showXAxisLabels showYAxisLabels isSynced xAxisVal followingViewWidth",
    "3D": "scene transforms layers topics cameraState followTf fixedFrame followMode publish",
    "Log": "searchTerms minLogLevel topicToRender nameFilter fontSize showLevel showDate showTime showName",
    "grid": "instanceId layerId label order drawBehind frameId visible size divisions lineWidth color position",
    "camera": "distance perspective phi target targetOffset targetOrientation thetaOffset fovy near far logDepth",
    "line": "enabled color label lineSize showLine value timestampMethod xValuePath",
}
"""The keys of panels that foxglove-sdk 0.30 publishes (`foxglove.layouts`), those that a layout of ours may have."""


def test_every_key_of_the_foxglove_layout_is_a_published_one(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "layout.json"
    CliRunner().invoke(app, ["layout", str(log), "--out", str(out)])
    layout = json.loads(out.read_text())
    for panel, config in layout["configById"].items():
        kind = panel.partition("!")[0]
        assert set(config) <= set(PUBLISHED[kind].split())
        for line in config.get("paths", ()):
            assert set(line) <= set(PUBLISHED["line"].split())
        for part, name in (("cameraState", "camera"), ("layers", "grid")):
            for one in config.get(part, {}).values() if part == "layers" else [config.get(part, {})]:
                assert set(one) <= set(PUBLISHED[name].split())
    splits = [layout["layout"]]
    while splits:
        split = splits.pop()
        assert split["direction"] in ("row", "column")
        assert 0.0 < split["splitPercentage"] < 100.0
        splits += [one for one in (split["first"], split["second"]) if isinstance(one, dict)]
