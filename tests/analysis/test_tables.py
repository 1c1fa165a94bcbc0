"""Tables and exports held against the mcap library and Protobuf's own decoder; the example notebook."""

import csv
import json
import re
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from typer.testing import CliRunner

import gcs_log
from analysis.cli import app
from gcs_log import flight_log
from mavlink_formation.installation import install_command
from tests.analysis.synthetic_flight import METADATA, START, T0_NS, Recipe, battery, shaken, written
from wire.logs.mcap_write import LogWriter

BODIES = ("lead", "left", "right")


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("tables") / "flight.mcap"
    said = [battery(T0_NS + 3_000_000_000 * k, 4.0 - 0.1 * k) for k in range(6)]
    return written(file, Recipe(error_lead=shaken), more=said, start=START)


def straight(path: Path, topic: str) -> list[tuple[int, Any]]:
    """(log time, message) of a topic, by nobody's code but the library's."""
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [(message.log_time, proto) for _, _, message, proto in reader.iter_decoded_messages(topics=[topic])]


def csv_of(folder: Path, name: str) -> dict[str, list[str]]:
    with (folder / name).open(newline="") as file:
        rows = list(csv.reader(file))
    return {head: [row[k] for row in rows[1:]] for k, head in enumerate(rows[0])}


@pytest.fixture(scope="module")
def exported(path: Path) -> Path:
    folder = path.with_name("flight-csv")
    result = CliRunner().invoke(app, ["export", str(path), "--csv"])
    assert result.exit_code == 0, result.output
    return folder


@pytest.mark.parametrize(
    ("topic", "field", "width"),
    [
        ("mocap/frame", "pos_lab_m", 3), ("mocap/frame", "q_lab_from_flu", 4), ("control/state", "vel_lab_m_s", 3),
        ("control/reference", "slot_lead_m", 3), ("control/command", "e_lead_m", 3),
        ("control/target", "thrust_norm", 1),
    ],
)  # fmt: skip
def test_csv_holds_the_very_numbers_of_the_log(path: Path, exported: Path, topic: str, field: str, width: int) -> None:
    told = straight(path, topic)
    table = csv_of(exported, topic.replace("/", "-") + ".csv")
    endings = {1: ("",), 3: ("_x", "_y", "_z"), 4: ("_w", "_x", "_y", "_z")}[width]
    for k, ending in enumerate(endings):
        wanted = [number for _, proto in told for number in list(getattr(proto, field))[k::width]]
        assert [float(text) for text in table[field + ending]] == wanted
    assert table["body"] == [*BODIES] * len(told)
    assert [int(text) for text in table["unix_ns"]] == [t_ns for t_ns, _ in told for _ in BODIES]


def test_events_phases_and_datagrams_are_words_and_bytes(path: Path, exported: Path) -> None:
    events = csv_of(exported, "event.csv")
    assert list(zip(events["source"], events["text"], strict=True)) == [
        (proto.source, proto.text) for _, proto in straight(path, "event")
    ]
    assert events["severity"] == ["NOTICE", "WARNING"]
    assert csv_of(exported, "phase.csv")["phase"][:3] == ["GROUND", "ARMED", "TAKEOFF"]
    assert csv_of(exported, "link-up.csv")["data"] == [proto.data.hex() for _, proto in straight(path, "link/up")]
    assert json.loads((exported / "metadata.json").read_text())["scenario"] == "synthetic"


def test_parquet_holds_what_csv_holds(path: Path) -> None:
    import pyarrow.parquet as pq

    result = CliRunner().invoke(app, ["export", str(path), "--parquet", "--out", str(path.with_name("out"))])
    assert result.exit_code == 0, result.output
    log = gcs_log.load(path)
    for topic, table in log.items():
        read = pq.read_table(path.with_name("out") / f"{topic.replace('/', '-')}.parquet").to_pydict()
        assert list(read) == list(table)
        for name, column in table.items():
            np.testing.assert_array_equal(np.array(read[name], column.dtype), column, err_msg=name)


def test_what_cannot_be_exported_says_what_to_do(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    for flags, words in (
        ([], "--csv, --parquet or --rosbag2"),
        (["--csv", "--parquet"], "--csv, --parquet or --rosbag2"),
        (["--parquet"], install_command("parquet")),
    ):
        result = CliRunner().invoke(app, ["export", str(path), *flags])
        assert result.exit_code == 2
        assert words in result.output


def test_a_table_is_read_when_it_is_looked_at_and_all_at_once(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read, asked = flight_log._contents, list[tuple[str, ...]]()

    def contents(path: Path, *names: str) -> list[Any]:
        asked.append(names)
        return read(path, *names)

    monkeypatch.setattr(flight_log, "_contents", contents)
    log = gcs_log.load(path)
    assert "control/state" in log
    assert len(log["control/state"]["t_s"]) == len(log["control/state"]["body"]) == 3000
    assert asked == [(), ("control/state",)]
    for _ in range(2):
        assert all(len(table["t_s"]) for table in log.values())
        assert {topic for topic, _ in log.items()} == set(log)
    assert (len(asked), set(asked[2])) == (3, set(log) - {"control/state"})
    with pytest.raises(KeyError, match="control/none"):
        log["control/none"]


def test_what_is_no_log_is_the_one_error_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "no.mcap").write_text("this is no log")
    LogWriter(tmp_path / "empty.mcap", METADATA, threaded=False).close()
    for name, words in (("no.mcap", "not an MCAP file"), ("empty.mcap", "no message of a flight in it")):
        with pytest.raises(gcs_log.LogError, match=rf"^.*{name}: {words}$"):
            gcs_log.load(tmp_path / name)
    with pytest.raises(FileNotFoundError):
        gcs_log.load(tmp_path / "absent.mcap")


def test_battery_is_a_table_of_its_own(path: Path) -> None:
    link = gcs_log.load(path)["drone/link"]
    assert set(link["body"]) == {"left"}
    assert link["battery_v"][0] == pytest.approx(8.0, abs=1e-3)
    assert link["battery"][-1] == 0.75
    np.testing.assert_allclose(np.diff(link["t_s"])[:-1], 0.1)


def test_the_log_knows_its_date(path: Path) -> None:
    log = gcs_log.load(path)
    assert f"{log.date:%Y-%m-%d %H:%M:%S %Z}" == "2026-09-21 14:13:20 UTC"
    assert log["mocap/frame"]["t_s"][0] == pytest.approx(0.004)


def test_the_example_notebook_runs(path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    notebook = json.loads((Path(__file__).parents[2] / "examples" / "flight.ipynb").read_text())
    monkeypatch.chdir(path.parent)
    names: dict[str, Any] = {}
    with mpl.rc_context({"backend": "agg"}):
        for cell in notebook["cells"]:
            if cell["cell_type"] == "code":
                exec("".join(cell["source"]), names)
        names["plt"].close("all")
    assert names["rms_mm"]["right"] == pytest.approx(1.0, abs=1e-6)
    assert "synthetic" in capsys.readouterr().out


def test_the_example_notebook_takes_the_error_and_not_its_rate() -> None:
    notebook = (Path(__file__).parents[2] / "examples" / "flight.ipynb").read_text()
    (pattern,) = re.findall(r'filter\(regex=\\"(.*?)\\"\)', notebook)
    columns = ["e_lead_m_x", "e_lead_m_y", "e_lead_m_z", "e_lead_m_s_x", "e_lead_m_s_y", "e_lead_m_s_z"]
    assert [name for name in columns if re.search(pattern, name)] == columns[:3]
