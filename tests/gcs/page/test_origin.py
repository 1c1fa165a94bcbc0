"""Other web pages in the operator's browser, and names that lead to loopback: none reaches the page's server."""

import asyncio
import http.client
import urllib.request
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from gcs.page.origin import OwnPagesOnly, policy, reject_reason
from tests.free_ports import free_port
from tests.gcs.fakes import triangle
from tests.gcs.page.flights import page_server
from wire import config_file


@pytest.mark.parametrize(
    ("host", "origin", "allowed"),
    [
        ("127.0.0.1:8470", None, True),
        ("127.0.0.1:8470", "http://127.0.0.1:8470", True),
        ("[::1]:8470", "http://[::1]:8470", True),
        ("LOCALHOST:9000", "http://localhost:9000", True),
        ("127.0.0.1:8470", "https://evil.example", False),
        ("127.0.0.1:8470", "http://127.0.0.1:3000", False),
        ("127.0.0.1:8470", "http://localhost:8470", False),
        ("127.0.0.1:8470", "null", False),
        ("127.0.0.1:8470", "http://127.0.0.1:8470 http://127.0.0.1:8470", False),
        ("evil.example:8470", "http://evil.example:8470", False),
        ("127.0.0.1.evil.example:8470", None, False),
        ("evil.example@127.0.0.2", None, False),
        ("127.0.0.1:8470 127.0.0.1:8470", "http://127.0.0.1:8470", False),
        ("[::1", None, False),
        ("", None, False),
    ],
)
def test_only_the_page_itself_may_speak_to_its_server(host: str, origin: str | None, allowed: bool) -> None:
    assert (reject_reason(host, origin) == "") is allowed


def resident_mib(pid: int) -> float:
    (line,) = (line for line in Path(f"/proc/{pid}/status").read_text().splitlines() if line.startswith("VmRSS"))
    return int(line.split()[1]) / 1024


@pytest.mark.parametrize("host", [b"127.0.0.1:8470", b"evil.example"])
def test_no_page_may_frame_it_whatever_is_answered(host: bytes) -> None:
    sent: list[dict[str, object]] = []

    async def app(_scope, _receive, send) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": [(b"content-type", b"text/html")]})
        await send({"type": "http.response.body", "body": b"<script>1</scr", "more_body": True})
        await send({"type": "http.response.body", "body": b"ipt>"})

    async def send(message) -> None:
        sent.append(message)

    server = OwnPagesOnly(app, on_reject=lambda _source, _why: None)
    asyncio.run(server({"type": "http", "headers": [(b"host", host)]}, None, send))
    headers = dict(sent[0]["headers"])
    assert b"frame-ancestors 'none'" in headers[b"content-security-policy"]
    assert b"default-src 'self'" in headers[b"content-security-policy"]
    assert headers[b"x-frame-options"] == b"DENY"
    assert headers[b"content-type"] in (b"text/html", b"text/plain")


def test_only_scripts_that_the_document_came_with_run():
    """The hash of `1` is known from elsewhere: `printf 1 | openssl dgst -sha256 -binary | base64`."""
    told = policy(b'<script src="/a.js"></script><script type="module">1</script><b onclick="x()">').decode()
    scripts = next(part for part in told.split("; ") if part.startswith("script-src"))
    assert scripts == "script-src 'self' 'unsafe-eval' 'sha256-a4ayc/80/OGda4BO/1o/V0etpOqiLx1JwB5S3beHW0s='"
    assert policy(b"").decode().count("sha256-") == 0


@pytest.mark.processes
def test_a_foreign_page_s_websocket_is_rejected_and_reported_and_fetching_leaves_nothing(tmp_path: Path) -> None:
    lab = tmp_path / "lab.toml"
    link = {"zenoh_listen": [f"tcp/127.0.0.1:{free_port()}"], "zenoh_connect": []}
    lab.write_text(config_file.dump(triangle(link=link)))
    with page_server(lab, 1.0) as (url, process):
        socket = f"ws://{urlsplit(url).netloc}/_nicegui_ws/socket.io/?EIO=4&transport=websocket"
        with connect(socket, origin=url) as ours:
            assert str(ours.recv(timeout=30.0)).startswith('0{"sid"')
        with pytest.raises(InvalidStatus, match="403"), connect(socket, origin="https://evil.example"):
            pass
        for path in ("/", "/_nicegui_ws/socket.io/?EIO=4&transport=polling"):
            asked = http.client.HTTPConnection(urlsplit(url).netloc, timeout=30.0)
            asked.request("GET", path, headers={"Host": "evil.example:8470"})
            answer = asked.getresponse()
            assert (answer.status, answer.read()[:9]) == (403, b"refused: ")
            asked.close()
        resident = []
        for count in (50, 300):
            for _ in range(count):
                urllib.request.urlopen(url, timeout=30.0).read()
            resident.append(resident_mib(process.pid))
        assert resident[1] - resident[0] < 20.0
    told = (tmp_path / "page.log").read_text().splitlines()
    assert "https://evil.example: refused: 1 x a page of another origin" in told
    assert "evil.example:8470: refused: 1 x its host is not this machine by 127.0.0.1 or localhost" in told
