"""One browser's page: its elements, what they show, and what they ask. The server behind it is `gcs.page.shell`."""

import math
from collections.abc import Awaitable, Callable
from contextlib import AbstractContextManager, suppress
from typing import Any

from nicegui import ui

from formation.config import CONFIGURED
from formation.guidance.shape import known
from formation.guidance.shape_request import ShapeRequest
from formation.messages import OperatorReply, Phase, Verb
from formation.security_config import MAY_ASK, Role
from gcs.alarms import severities
from gcs.page import drawing
from gcs.page.drawing import Stand, above, perspective
from gcs.page.model import Model
from gcs.page.show import LABELS, VERBS, Show
from gcs.security.page_logins import Visitor

Ask = Callable[[Verb, str, Visitor | None], Awaitable[OperatorReply]]

ANSWER_FOR = 150
"""Beats: an answer of 15 s ago is no answer to what is seen now."""
KEYS = (Verb.STOP, Verb.HOLD, Verb.LAND)
MOVED_MOST = 10_000.0


class Viewer:
    """The elements of one browser, drawn for every state; name: among the viewers, once it is connected.

    A stop is everybody's, whoever has the control.
    """

    def __init__(self, model: Model, ask: Ask, visitor: Visitor | None = None) -> None:
        """visitor: who it is, where it came by the door for other machines."""
        self.name, self.visitor = "", visitor
        self._model, self._ask = model, ask
        self._stand, self._beats = Stand(), 0
        self._answered: int | None = None
        """The beat of the last answer that is shown."""
        fence = model.config.limits.fence
        self._crowd = len(model.config.commanded) > 8
        self._sizes = ((640.0, 540.0), (640.0, 540.0))
        """Of the two rooms' panels, px, as the browser reports them."""
        self._above = above(fence, *self._sizes[1])
        with ui.element("main").classes("page"):
            with ui.element("header").classes("head"):
                self._head = ui.html(sanitize=False).classes("headwords")
            with ui.element("div").classes("rooms"):
                with ui.element("div").classes("room turning"):
                    self._still3 = ui.html(sanitize=False).classes("layer")
                    self._moving3 = ui.html(sanitize=False).classes("layer")
                    ui.html('<div class="name">drag to turn, wheel to zoom</div>', sanitize=False)
                with ui.element("div").classes("room"):
                    self._still2 = ui.html(sanitize=False).classes("layer")
                    self._moving2 = ui.html(sanitize=False).classes("layer")
                    ui.html('<div class="name">from above</div>', sanitize=False)
            self._table = ui.html(sanitize=False).classes("table many" if self._crowd else "table")
            self._vital = ui.html(sanitize=False).classes("vital")
            with ui.element("aside").classes("side"):
                self._side()
        self._lost = ui.html(sanitize=False).classes("lost")
        self._beat = ui.html("0", sanitize=False).props("id=beat")
        ui.on("key", lambda event: self._key(str(event.args)))
        ui.on("turn", lambda event: self._turn(event.args))
        ui.on("zoom", lambda event: self._zoom(event.args))
        ui.on("size", lambda event: self._resize(event.args))
        self._draw_still()

    def _side(self) -> None:
        with ui.element("button").classes("stop").props('aria-label="STOP: cut all motors"') as stop:
            ui.html("STOP<small>space bar &middot; cuts every motor now</small>", sanitize=False)
        stop.on("pointerdown", lambda: self.ask(Verb.STOP)).on("keydown.enter", lambda: self.ask(Verb.STOP))
        self._stopped = ui.html(sanitize=False).classes("stopped")
        if self.visitor is not None:
            ui.html(drawing.visitor(self.visitor.name, self.visitor.role), sanitize=False).classes("notice visitor")
        self._control_status = ui.html(sanitize=False).classes("notice")
        with ui.element("div").classes("take") as self._take_control:
            ui.button("Take the control over", on_click=self._take_over, color=None).props("unelevated no-caps")
        with ui.element("div").classes("buttons"):
            self._buttons = {verb: self._button(verb) for verb in VERBS}
        self._against = ui.html(sanitize=False).classes("against")
        self._answer = ui.html(sanitize=False).classes("answer")
        self._forms = {Verb.SHAPE: self._shape_form()}
        if self._model.config.leader.sysid is not None and self._model.config.leader.trajectories:
            self._forms[Verb.TRAJECTORY] = self._trajectory_form()
        with ui.element("div").classes("alarmbox"):
            with ui.element("div").classes("alarmhead"):
                self._alarm_count = ui.label("no alarms")
                self._seen = ui.button("Acknowledge", on_click=self._acknowledge, color=None).props(
                    "dense unelevated no-caps"
                )
            self._alarms = ui.html(sanitize=False).classes("alarms")

    def _shape_form(self) -> ui.button:
        with ui.element("div").classes("form"):
            names = list(known(self._model.config))
            shape = ui.select(names, value=names[0], label="shape").props("dense options-dense dark")
            scale = ui.number("scale", value=1.0, min=0.1, max=100.0, step=0.1).props("dense dark")
            heading = ui.number("heading °", value=0.0, min=-360, max=360, step=15).props("dense dark")

            def asked() -> str:
                heading_rad = math.radians(float(heading.value or 0.0))
                return ShapeRequest(str(shape.value), float(scale.value or 1.0), heading_rad).text

            return self._button(Verb.SHAPE, asked)

    def _trajectory_form(self) -> ui.button:
        with ui.element("div").classes("form way"):
            names = [CONFIGURED, *self._model.config.leader.trajectories]
            label = "leader's trajectory"
            path = ui.select(names, value=CONFIGURED, label=label).props("dense options-dense dark id=way")
            return self._button(Verb.TRAJECTORY, lambda: str(path.value))

    def _button(self, verb: Verb, asked: Callable[[], str] = str) -> ui.button:
        """The button that asks for it; asked: with which argument."""
        keys = {Verb.HOLD: " · H", Verb.LAND: " · L"}.get(verb, "")
        return ui.button(LABELS[verb] + keys, on_click=lambda: self.ask(verb, asked()), color=None).props(
            f"unelevated no-caps id=do-{verb}"
        )

    def may(self, verb: Verb) -> bool:
        """Whether its role may ask for it."""
        return self.visitor is None or verb in MAY_ASK[self.visitor.role]

    @property
    def may_command(self) -> bool:
        """Whether its role may ask for more than every role."""
        return self.visitor is None or self.visitor.role is not Role.VIEWER

    @property
    def commands(self) -> bool:
        """Whether this viewer has the control."""
        return self._model.control.holder == self.name

    async def ask(self, verb: Verb, argument: str = "") -> None:
        """Ask the ground, and show its answer; from a viewer that only looks on, nothing but a stop."""
        if self.may(verb) and verb is not Verb.STOP and not self.commands:
            return  # what its role forbids the ground refuses, and records
        name = verb.command_name
        self._show_answer(f"{name} ...", True)
        reply = await self._ask(verb, argument, self.visitor)
        self._show_answer(
            f"{name}: {reply.text}" if reply.accepted else f"{name} refused: {reply.text}", reply.accepted
        )
        self._answered = self._beats

    def update(self, shown: Show) -> None:
        """Show it."""
        model, fence = self._model, self._model.config.limits.fence
        self._beats += 1
        if self._answered is not None and self._beats - self._answered > ANSWER_FOR:
            self._show_answer("", True)
        self._beat.content = str(self._beats)
        self._head.content, self._vital.content = drawing.head(shown), drawing.vital(shown)
        self._table.content, self._lost.content = drawing.table(shown), drawing.lost(shown)
        self._against.content = drawing.steps(shown, self.commands)
        self._stopped.content = drawing.stopped(shown)
        self._control_status.content = drawing.plain(model.control.status_text(self.name))
        self._take_control.set_visibility(self.may_command and not self.commands)
        allowed = {step.verb: step.allowed for step in shown.steps}
        for verb, button in self._forms.items():
            may = self.may(verb) and (verb is Verb.SHAPE or model.may_choose)
            button.set_enabled(self.commands and not shown.lost and may)
        self._buttons[Verb.RESET].set_visibility(shown.phase is Phase.STOPPED)
        for verb, button in self._buttons.items():
            button.set_enabled(self.commands and self.may(verb) and allowed.get(verb, False) and not shown.lost)
        open_ = model.alarms.open
        self._alarms.content = drawing.alarms(open_, model.alarms.latest)
        self._alarm_count.text = severities(open_) or "no alarms"
        self._alarm_count.classes(replace="loud" if model.alarms.loud else "")
        self._seen.set_visibility(any(not alarm.acknowledged for alarm in open_))
        self._seen.set_enabled(self.commands)
        camera = perspective(fence, self._stand, *self._sizes[0])
        self._moving3.content = drawing.svg(camera, drawing.moving(camera, model.scene, self._crowd), "the room")
        top = drawing.moving(self._above, model.scene)
        self._moving2.content = drawing.svg(self._above, top, "the room from above")

    def _show_answer(self, text: str, accepted: bool) -> None:
        self._answered = None
        self._answer.classes(replace="answer" if accepted else "answer refused")
        self._answer.content = drawing.plain(text)

    def _take_over(self) -> None:
        if not self.may_command:
            return
        self._model.control.take_control(self.name)

    async def _acknowledge(self) -> None:
        if self.commands:
            self._model.alarms.acknowledge()
            await self.ask(Verb.ACKNOWLEDGE)

    async def _key(self, name: str) -> None:
        if name in KEYS:
            await self.ask(Verb(name))

    def _turn(self, moved: Any) -> None:
        with _browsers_words():
            right_px, up_px = map(moved_px, moved)
            self._stand = self._stand.turned(-0.008 * right_px, 0.006 * up_px)
            self._draw_still()

    def _zoom(self, steps: Any) -> None:
        with _browsers_words():
            self._stand = self._stand.nearer(1.1 ** moved_px(steps))
            self._draw_still()

    def _draw_still(self) -> None:
        fence = self._model.config.limits.fence
        camera = perspective(fence, self._stand, *self._sizes[0])
        self._above = above(fence, *self._sizes[1])
        self._still3.content = drawing.svg(camera, drawing.still(camera, fence), "the fence")
        self._still2.content = drawing.svg(self._above, drawing.still(self._above, fence), "the fence from above")

    def _resize(self, sizes: Any) -> None:
        """The panels have other sizes now: the room fills each."""
        with _browsers_words():
            wide3, high3, wide2, high2 = (max(moved_px(size), 50.0) for size in sizes)
            self._sizes = ((wide3, high3), (wide2, high2))
            self._draw_still()


def moved_px(moved: Any) -> float:
    """A number as a browser sends it; ValueError for one that no mouse moves by: not finite, or past any screen."""
    value = float(moved)
    if not abs(value) <= MOVED_MOST:
        raise ValueError(f"{value} is no way of a mouse")
    return value


def _browsers_words() -> AbstractContextManager[None]:
    """While inside, an event that no page of ours sends changes nothing."""
    return suppress(TypeError, ValueError, ArithmeticError)
