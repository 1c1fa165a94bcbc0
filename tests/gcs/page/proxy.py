"""The shipped reverse proxy, played: TLS before, the headers of `examples/nginx-page.conf` behind."""

import asyncio
import re
import ssl
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

CONF = Path(__file__).parents[3] / "examples" / "nginx-page.conf"
CLIENT = "192.0.2.7"
"""Where whoever comes through the proxy is said to be."""


def shipped_directives() -> dict[str, str]:
    """The directives of the shipped configuration, `proxy_set_header NAME` each by its own name."""
    text = re.sub(r"#.*", "", CONF.read_text())
    found = re.findall(r"^\s*((?:proxy_set_header\s+)?\S+)\s+([^;{]+);", text, re.MULTILINE)
    return {" ".join(key.split()): value.strip() for key, value in found}


def forwarded(head: bytes, host: str) -> bytes:
    """The head of a request as the proxy hands it on: its own headers in the place of the client's."""
    own = {
        key.removeprefix("proxy_set_header "): value
        for key, value in shipped_directives().items()
        if key.startswith("proxy_set_header ")
    }
    first, *lines = head.decode("latin-1").split("\r\n")
    upgrade = next((line.partition(":")[2].strip() for line in lines if line.lower().startswith("upgrade:")), "")
    own |= {"Host": host, "X-Forwarded-For": CLIENT}
    own |= {"Upgrade": upgrade, "Connection": "upgrade" if upgrade else "close"}
    rest = [line for line in lines if line and line.partition(":")[0].lower() not in {key.lower() for key in own}]
    return "\r\n".join([first, *rest, *(f"{k}: {v}" for k, v in own.items() if v), "", ""]).encode("latin-1")


@contextmanager
def proxy(own: Path, port: int, behind: int) -> Iterator[None]:
    """While inside, https://127.0.0.1:port leads to the port behind it; own: the folder of the certificate."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(own / "certificate.pem", own / "private.pem")
    ready, ended = threading.Event(), threading.Event()

    async def carry(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        ends = [writer]
        try:
            head = await reader.readuntil(b"\r\n\r\n")
            to_page, from_us = await asyncio.open_connection("127.0.0.1", behind)
            ends.append(from_us)
            from_us.write(forwarded(head.removesuffix(b"\r\n\r\n"), f"127.0.0.1:{port}"))
            await asyncio.gather(pump(reader, from_us), pump(to_page, writer))
        except (OSError, asyncio.IncompleteReadError):
            pass
        finally:
            for end in ends:
                end.transport.abort()

    async def pump(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(OSError):
            while data := await reader.read(65536):
                writer.write(data)
                await writer.drain()
        writer.close()

    async def serve() -> None:
        async with await asyncio.start_server(carry, "127.0.0.1", port, ssl=context):
            ready.set()
            await asyncio.to_thread(ended.wait)

    thread = threading.Thread(target=lambda: asyncio.run(serve()), daemon=True)
    thread.start()
    try:
        assert ready.wait(10.0)
        yield
    finally:
        ended.set()
        thread.join(10.0)
