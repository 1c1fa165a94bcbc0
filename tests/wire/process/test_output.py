"""What a daemon prints stops no flight: readers that are gone, full disks, terminals that take nothing."""

import os
import re
import signal
import sys
from pathlib import Path

from wire.process.output import DroppingStream, dropping_output, lost_lines


def test_a_full_disk_or_a_reader_that_is_gone_loses_lines_and_counts_them() -> None:
    reads, writes = os.pipe()
    os.close(reads)
    for descriptor in (os.open("/dev/full", os.O_WRONLY), writes):
        stream = DroppingStream(descriptor)
        print("one", "two", sep="\n", file=stream)
        stream.drain()
        assert stream.lost_lines == 2
        os.close(descriptor)


def test_a_reader_that_takes_nothing_holds_up_nobody_and_reads_later_what_is_missing() -> None:
    reads, writes = os.pipe()
    stream = DroppingStream(writes)
    for _ in range(3000):
        print("x" * 100, file=stream, flush=True)
    whole = 3000 - stream.lost_lines
    assert 0 < whole < 3000
    with open(reads, encoding="utf-8") as reader:
        said: list[str] = []
        while said.count("x" * 100 + "\n") < whole:
            said.append(reader.readline())
        print("the end", file=stream)
        said += iter(reader.readline, "the end\n")
    notes = [line for line in said if not line.startswith("x")]
    assert sum(int(re.sub(r"\D", "", note)) for note in notes) == 3000 - whole
    os.close(writes)


def test_inside_no_output_and_no_hang_up_raises_and_the_order_of_lines_is_kept(tmp_path: Path, monkeypatch) -> None:
    with (tmp_path / "said").open("w+") as out, (tmp_path / "said").open("a") as err:
        monkeypatch.setattr(sys, "stdout", out)
        monkeypatch.setattr(sys, "stderr", err)
        with dropping_output():
            os.kill(os.getpid(), signal.SIGHUP)
            for k in range(50):
                print(k, file=sys.stderr if k % 2 else sys.stdout)
            assert lost_lines() == 0
        assert sys.stdout is out
    assert (tmp_path / "said").read_text().split() == [str(k) for k in range(50)]
