"""The page's process: hears the lab's bus, serves browsers on loopback, asks the ground as any operator.

What runs in the browser is the style and the little script in `browser`, which decides nothing: it hands keys on,
beeps, and says across the page when nothing has come of the server for a while.
"""

import asyncio
import json
import os
import socket
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import uvicorn
from nicegui import Client, app, background_tasks, ui

from formation.config import LabConfig
from formation.messages import OperatorReply, OperatorRequest, Verb
from formation.requests import answer_s
from gcs.page.door import Door
from gcs.page.model import Model
from gcs.page.origin import VISITOR, OwnPagesOnly
from gcs.page.viewer import Viewer
from gcs.rehearsal import recorded
from gcs.security.page_logins import Logins, Visitor, read_tokens
from gcs.security.roles import visitor_source
from wire.clock import Clock, unix_us
from wire.errors import ConfigError
from wire.process.daemon import GROUND_REMEDY, Precondition, report_missing
from wire.process.port_holder import why_not_bound
from wire.process.program import print_event
from wire.process.system import own_name
from wire.rejections import RejectionLog
from wire.security.protection import LOOPBACK_ONLY, Protection
from wire.text import plain
from wire.transport.mocap_bus import MocapBus
from wire.transport.zenoh_bus import ZenohBus

FOLDER = Path(__file__).parent / "browser"
LOOPBACK = "127.0.0.1"
PORTS = range(8470, 8490)
FETCHED_MOST = 8
"""Pages that were fetched by somebody who has not connected yet; the oldest is dropped, and has to be loaded again."""
WATCH_S = 0.25
"""How often the page is drawn where no state comes; the browser notices a server that draws nothing for 1.5 s."""


class Page:
    """One lab's page: a model and its viewers."""

    def __init__(
        self, lab_file: Path, config: LabConfig, ground: str, clock: Clock, protection: Protection = LOOPBACK_ONLY
    ) -> None:
        self.model = Model(config)
        self.parent: int | None = None
        self._lab_file = lab_file
        self._config, self._ground, self._clock = config, ground, clock
        self._protection = protection
        self._viewers: dict[str, Viewer] = {}
        self._fetched: list[Client] = []
        """Those who have fetched the page and are not connected."""
        self._bus: ZenohBus | None = None
        self._style = (FOLDER / "page.css").read_text(encoding="utf-8")
        self._script = (FOLDER / "page.html").read_text(encoding="utf-8")
        self._reject_log = RejectionLog()
        self._count = 0
        self._drawn_ns = 0
        identity, security = protection.bus.identity, config.security
        operators = {} if security is None else security.operators
        self.logins = Logins(operators, lambda: {} if identity is None else read_tokens(identity))

    @asynccontextmanager
    async def subscribed(self) -> AsyncIterator[None]:
        """While inside, the bus is heard."""
        bus = await ZenohBus.open(self._config.link.joined, self._config.name, protection=self._protection)
        self._bus = bus
        try:
            bus.on_state(self._ground, self._receive_state)
            mocap = MocapBus(bus, self._clock)
            mocap.on_state(self._receive_mocap_state)
            yield
        finally:
            await bus.close()

    async def ask(self, verb: Verb, argument: str, visitor: Visitor | None = None) -> OperatorReply:
        """The ground's answer; that there is none is one of refusal. visitor: on another machine, who asks."""
        if visitor is not None and not self._is_logged_in(visitor):
            return OperatorReply(unix_us(), False, "you are not logged in any more: load the page again")
        source = f"page of {own_name()}" if visitor is None else visitor_source(visitor.name, visitor.address)
        request = OperatorRequest(unix_us(), verb, argument, source)
        if self._bus is None:
            return OperatorReply(request.id, False, "not on the bus yet")
        try:
            return await self._bus.ask(self._ground, request, answer_s(verb) / self._clock.speed)
        except TimeoutError as error:
            return OperatorReply(request.id, False, f"no ground answers: {error}")

    def build(self, client: Client) -> None:
        """Somebody asks for the page; who only fetches it is no viewer yet."""
        ui.add_css(self._style)
        ui.add_body_html(self._script)
        visitor = None if client.request is None else client.request.scope.get(VISITOR)
        viewer = Viewer(self.model, self.ask, visitor)
        self._fetched = [each for each in self._fetched if not each.has_socket_connection and not each.is_deleted]
        self._fetched.append(client)
        while len(self._fetched) > FETCHED_MOST:
            self._fetched.pop(0).delete()
        client.on_connect(lambda: self._come(viewer))
        client.on_disconnect(lambda: self._leave(viewer))

    def reject(self, source: str, why: str) -> None:
        """Report a rejected input of somebody else: a line here, and an alarm, at most once a second."""
        now_ns = self._clock.monotonic_ns()
        self._reject_log.note(plain(source, 80), why, now_ns)
        for event in self._reject_log.due(now_ns):
            print_event(event)
            self.model.alarms.receive(event, unix_us() * 1e-6)

    def draw(self) -> None:
        """Show every viewer what there is."""
        self._drawn_ns = now_ns = self._clock.monotonic_ns()
        shown = self.model.show(now_ns, unix_us() * 1e-6)
        for viewer in tuple(self._viewers.values()):
            if viewer.visitor is None or self._is_logged_in(viewer.visitor):
                try:
                    viewer.update(shown)
                except (ArithmeticError, AttributeError, LookupError, RuntimeError, TypeError, ValueError) as error:
                    # One page that fails must not end everybody's.
                    self._leave(viewer)
                    self.reject(viewer.name, f"page that cannot be drawn: {type(error).__name__}: {error}")

    async def report_awaited(self) -> None:
        """Say on the terminal, too, that no ground is heard, and when one is."""
        ground = Precondition(f"ground {self._ground!r}", lambda: self.model.state is not None, GROUND_REMEDY)
        await report_missing("page", [ground], print_event)

    async def watch(self) -> None:
        """Draw where no state comes, until the parent that this is to end with, if any, has gone."""
        while self.parent in (None, os.getppid()):
            await asyncio.sleep(WATCH_S)
            self.model.rehearsal = recorded(self._lab_file)
            if self._clock.monotonic_ns() - self._drawn_ns > WATCH_S * 1e9:
                self.draw()
        app.shutdown()

    def _come(self, viewer: Viewer) -> None:
        if not viewer.name:
            self._count += 1
            viewer.name = f"viewer {self._count}" if viewer.visitor is None else f"{viewer.visitor.name} {self._count}"
        self._viewers[viewer.name] = viewer
        self.model.control.come(viewer.name, may_command=viewer.may_command)

    def _is_logged_in(self, visitor: Visitor) -> bool:
        """Whether the operator's session goes on: its token may be void by now."""
        try:
            found = self.logins.visitor(visitor.session, visitor.address, self._clock.monotonic_ns())
        except ConfigError:
            return False
        return found is not None

    def _leave(self, viewer: Viewer) -> None:
        self._viewers.pop(viewer.name, None)
        self.model.control.leave(viewer.name)

    def _receive_state(self, text: str) -> None:
        try:
            self.model.receive_state(text, self._clock.monotonic_ns())
        except ValueError as error:
            self.reject(f"state of ground {self._ground!r}", str(error))
        self.draw()

    def _receive_mocap_state(self, state: dict[str, Any]) -> None:
        try:
            self.model.receive_mocap_state(state, self._clock.monotonic_ns())
        except ValueError as error:
            self.reject("state of the mocap process", str(error))


def free_port(wanted: int | None) -> int:
    """The port wanted, or the first free one from 8470 on; OSError where it is another's."""
    why = ""
    for port in PORTS if wanted is None else (wanted,):
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((LOOPBACK, port))
            except OSError as error:
                why = f"port {port} of {LOOPBACK}: {why_not_bound(error, 'tcp', port)}"
                if wanted is None:
                    print(f"page: {why}; trying the next one", file=sys.stderr)
                continue
            return port
    raise OSError(f"{why}: --port for another")


@dataclass(frozen=True, slots=True)
class Public:
    """Where other machines reach the page: a reverse proxy's address, https://HOST:PORT, and the port that it forwards
    to, on loopback."""

    address: str
    port: int


class _DoorServer(uvicorn.Server):
    """A second server of the process; its signals are the first one's."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """None of them."""
        yield


def _door(page: Page, public: Public, clock: Clock) -> _DoorServer:
    """The server for other machines; OSError where its port is taken. The address of who asks is the proxy's word."""
    app_for_others = Door(app, public.address, page.logins, clock.monotonic_ns, page.reject)
    return _DoorServer(
        uvicorn.Config(
            app_for_others,
            host=LOOPBACK,
            port=free_port(public.port),
            lifespan="off",
            log_level="warning",
            access_log=False,
            proxy_headers=True,
            forwarded_allow_ips=LOOPBACK,
            server_header=False,
        )
    )


def serve(
    lab_file: Path,
    config: LabConfig,
    ground: str,
    wanted_port: int | None,
    clock: Clock,
    as_json: bool,
    protection: Protection = LOOPBACK_ONLY,
    public: Public | None = None,
    parent: int | None = None,
) -> None:
    """Serve the page on loopback until SIGINT or SIGTERM, at that port or at a free one. OSError if it is taken,
    or a bus on another machine is not authenticated.

    as_json: print where it is as JSON, too. public: serve it to other machines, too, with a login. parent: end with
    that process, which started this one.
    """
    joined = config.link.joined
    protection.bus.demand((*joined.zenoh_listen, *joined.zenoh_connect))  # here, where it ends the program in a line
    port = free_port(wanted_port)
    page = Page(lab_file, config, ground, clock, protection)
    page.parent = parent
    on_bus = page.subscribed()
    door = None if public is None else _door(page, public, clock)

    async def begin() -> None:
        await on_bus.__aenter__()
        if door is not None:
            background_tasks.create(door.serve(), name="door")
        background_tasks.create(page.watch(), name="watch")
        background_tasks.create(page.report_awaited(), name="awaited")
        background_tasks.create(protection.attend(lambda e: page.reject(e.source, e.text)), name="keys")

    async def end() -> None:
        if door is not None:
            door.should_exit = True
        await on_bus.__aexit__(None, None, None)

    app.add_middleware(OwnPagesOnly, on_reject=page.reject)
    app.on_startup(begin)
    app.on_shutdown(end)
    print(f"page: http://{LOOPBACK}:{port}", file=sys.stderr)
    forward = f"ssh -L {port}:{LOOPBACK}:{port} USER@{socket.gethostname()}"
    print(
        f"page: from a tablet or another computer: {forward}, then the same address there", file=sys.stderr, flush=True
    )
    if public is not None:
        print(f"page: from other machines, with a login: {public.address}", file=sys.stderr, flush=True)
    if as_json:
        print(json.dumps({"url": f"http://{LOOPBACK}:{port}", "forward": forward}), flush=True)
    ui.run(
        page.build, host=LOOPBACK, port=port, title=f"{config.name}: formation", dark=True, reload=False, show=False,
        show_welcome_message=False, uvicorn_logging_level="warning", reconnect_timeout=3.0, access_log=False,
        gzip_middleware_factory=None,
        ws_per_message_deflate=False,  # to this very machine: it costs more than all the drawing
    )  # fmt: skip
