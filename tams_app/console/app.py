"""Sessions on the terminal: a live line, the window, the headset, and a table at the end."""

from __future__ import annotations

import threading
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

from tams_app.config import Config
from tams_app.errors import SetupError, SignalledError, TamsError
from tams_app.faces.commands import Command, OperatorSignals
from tams_app.faces.display import has_display
from tams_app.faces.registry import (
    FACES,
    FacedSession,
    SessionDisplay,
    ShownReplay,
    ShownTrial,
    check_faces,
)
from tams_app.faces.session_face import carry_out
from tams_app.faces.terminal.keys import KeyPresses, TerminalKeys, handled_signals
from tams_app.faces.terminal.line import StatusLine, WordsOf, status_words
from tams_app.faces.terminal.output import unblocked_output
from tams_app.printing import Console
from tams_app.robot.build import check_hand, check_names, check_ready_pose, check_views
from tams_app.robot.control import Signals
from tams_app.runtime.clock import MonotonicClock
from tams_app.runtime.mailbox import Sentences
from tams_app.runtime.shared_ring import require_room
from tams_app.runtime.worker import Worker
from tams_app.session.folder import (
    create_session_folder,
    remove_session_folder,
    robot_bytes,
    session_bytes,
    station_bytes,
)
from tams_app.session.run import run
from tams_app.session.session import Outset, Session
from tams_app.session.viewing import check_viewers
from tams_app.station.seat import require_local_seat
from tams_app.teleop.hands import hand_of, words_of_hand

if TYPE_CHECKING:
    from tams_app.link.gateway_client import Endpoint
    from tams_app.link.page_client import PagePlace

POLL_S = 0.05
Made: TypeAlias = tuple[Outset, AbstractContextManager[Session]]  # a session, and what opens it


class ShownOutset(Protocol):
    """What there is of a session before it is open, as the console sees it."""

    config: Config
    folder: Path
    failure: str

    @property
    def signals(self) -> OperatorSignals: ...

    def fail(self, sentence: str) -> None: ...

    def note(self, level: str, text: str) -> None: ...

    def request_end(self, reason: str) -> None: ...


class ShownSession(FacedSession, Protocol):
    """The open session as the console sees it."""

    ended: threading.Event

    @property
    def sentences(self) -> Sentences: ...

    def poll(self) -> None: ...

    def stop_arm(self) -> None: ...


def run_session(config: Config, arm_at_once: bool, dry_run: bool = False) -> None:
    """Run one session to its end. Everything it leaves is in its own folder.

    SignalledError, after all is done, if a signal ended it.
    """
    check_session(config, dry_run, session_bytes(config))

    def make(folder: Path) -> Made:
        outset = Outset(config, MonotonicClock(), folder, Signals())
        return outset, run(outset, arm_at_once, dry_run)

    run_and_report(config, make, may_repeat=config.rig.enabled)


def run_robot(
    config: Config,
    endpoint: Endpoint | None,
    arm_at_once: bool,
    dry_run: bool,
    place: PagePlace | None = None,
) -> None:
    """Run the robot's side of two until its session ends.

    `endpoint`: where it listens; None: a page on this computer alone may call, and is opened in a
    browser. `place`: of the page that may call, if one may.
    """
    from tams_app.link.keys import accepted_keys
    from tams_app.session.robot import for_robot, robot

    check_session(config, dry_run, robot_bytes(config))

    def make(folder: Path) -> Made:
        outset = Outset(for_robot(config), MonotonicClock(), folder, Signals())
        if endpoint is not None:
            keys = [] if endpoint.key is None else accepted_keys(endpoint.key)
            whose = f" with the key of {' or '.join(key.name for key in keys)}" if keys else ""
            where = f"{endpoint.host}:{endpoint.port}"
            outset.sentences.note(f"waiting for an operator on {where}{whose}")
        if place is None:
            return outset, robot(outset, endpoint, arm_at_once, dry_run)
        from tams_app.console.page import offered
        from tams_app.faces.page_tables import page_tables
        from tams_app.link.page_client import Page

        page = Page(place, page_tables(config))
        opening = robot(outset, endpoint, arm_at_once, dry_run, page)
        return outset, offered(opening, page, folder, opens=endpoint is None)

    run_and_report(config, make)


def run_operate(config: Config, endpoint: Endpoint) -> None:
    """Run the operator's side of two until either ends the session."""
    from tams_app.session.operate import operate
    from tams_app.station.linked_robot import Requests

    check_hand(config)
    check_faces(config)
    require_room(station_bytes(config))
    notify = partial(Console().print, soft_wrap=True)

    def make(folder: Path) -> Made:
        outset = Outset(config, MonotonicClock(), folder, Requests())
        return outset, operate(outset, endpoint, notify)

    run_and_report(config, make)


def check_session(config: Config, dry_run: bool, memory_bytes: int) -> None:
    """ConfigError for what cannot be run with an arm at this computer.

    SetupError if it has no room for `memory_bytes` of shared memory (`session.folder`).
    """
    check_names(config)
    check_faces(config)
    check_ready_pose(config)
    check_views(config, dry_run)
    require_room(memory_bytes)


def run_and_report(config: Config, make: Callable[[Path], Made], may_repeat: bool = False) -> None:
    """Run the session that `make` makes for its folder, and report on it.

    `may_repeat`: the operator may start it anew from the window, as often as they like.
    """
    check_viewers(config)
    console = Console()
    console.print("starting …")
    while _run_once(config, make, console, may_repeat):
        console.print("starting again …")


def _run_once(
    config: Config, make: Callable[[Path], Made], console: Console, may_repeat: bool
) -> bool:
    """One session and its report; whether the operator asks for another one."""
    folder = create_session_folder(config)
    outset: Outset | None = None
    signals: list[str] = []
    closed = again = False
    try:
        outset, opening = make(folder)
        with showing(outset, opening, console, signals=signals, shows_end=True) as faces:
            closed = True
            from tams_app.console.end_screen import ask_at_end  # not before the session is over
            from tams_app.console.report import report_session

            summary: Mapping[str, Any] | None = None
            try:
                summary = report_session(folder, console)
            except TamsError:
                if not outset.failure:  # else that is what matters, and the reason for this
                    raise
            if not signals and config.seconds is None:
                again = ask_at_end(
                    faces, console, config, outset.failure, summary, folder, signals, may_repeat
                )
    except TamsError as error:
        if outset is None or not outset.started:
            remove_session_folder(folder, str(error))
        if signals and not closed:  # it was ended before it had started
            raise SignalledError(str(error)) from error
        raise
    if outset.failure:
        raise TamsError(f"{outset.failure} (the log is in {folder})")
    if signals:
        raise SignalledError(f"{signals[0]}; all that was recorded is in {folder}")
    return again


def show_session(
    outset: ShownOutset,
    opening: AbstractContextManager[ShownSession],
    console: Console,
    words_of: WordsOf = status_words,
    signals: list[str] | None = None,
    trial: ShownTrial | None = None,
    replay: ShownReplay | None = None,
) -> None:
    """Show a session from start to end; no face stays for what follows. As of `showing`."""
    with showing(outset, opening, console, words_of, signals, trial, replay):
        pass


@contextmanager
def showing(
    outset: ShownOutset,
    opening: AbstractContextManager[ShownSession],
    console: Console,
    words_of: WordsOf = status_words,
    signals: list[str] | None = None,
    trial: ShownTrial | None = None,
    replay: ShownReplay | None = None,
    shows_end: bool = False,
) -> Iterator[Sequence[SessionDisplay]]:
    """Open a session, show it until it ends, close it; then its faces. TamsError without a start.

    No screen holds it up. `opening`: starts it, and closes it in the end. `signals`: takes those
    that end it. `trial`: of a study; nothing else may be notified of its session. `replay`: the
    session, where it is one. `shows_end`: of the faces those that can stay until the context is
    left, and show that it is over.
    """
    opened, over = list[ShownSession](), threading.Event()

    def end(reason: str) -> None:
        if signals is not None:
            signals.append(reason)
        outset.request_end(reason)
        for session in opened:
            session.stop_arm()

    def stop_arm() -> None:
        if not over.is_set():
            outset.signals.estop()

    def failed(name: str, failure: BaseException) -> None:
        try:
            outset.fail(f"{name}: {failure!r}")
        except Exception as again:  # noqa: BLE001 - the session has ended by then, and says so
            outset.note("error", f"the arm's stop failed again: {again!r}")

    with unblocked_output(), handled_signals(end, stop_arm, failed), ExitStack() as stack:
        faces = _launch_faces(outset.config, outset.folder, stack, trial, replay)
        try:
            with opening as session:
                opened.append(session)
                _watch(session, console, words_of, faces, trial, shows_end)
                console.print("ending …")
        finally:
            opened.clear()
            over.set()
        yield faces


def _watch(
    session: ShownSession,
    console: Console,
    words_of: WordsOf = status_words,
    faces: Sequence[SessionDisplay] = (),
    trial: ShownTrial | None = None,
    shows_end: bool = False,
) -> None:
    """Show the session until it ends; from the main thread.

    `shows_end`: of the faces those that can stay, and show that it is over.
    """
    with ExitStack() as stack:
        has_keys = _read_keys(session, stack, trial)
        for face in faces:  # to be closed before the keys: what it shows at the end gets old
            stack.callback(face.end if shows_end else face.close)
            face.open(session)
        if not session.config.operator_is_simulated:
            _show_how_to_begin(session, has_keys, bool(session.displays))
        line = stack.enter_context(StatusLine(console, words_of))
        stack.callback(session.stop_arm)  # however this ends, the arm comes first
        while not session.ended.wait(POLL_S):
            session.poll()
            for note in session.sentences.take():
                line.notify(note, session.elapsed_s())
                for face in faces:
                    face.notify(note)
            for face in faces:
                face.refresh()
            if line.is_due(session.elapsed_s()):
                line.update(session.state())
        for note in session.sentences.take():
            line.notify(note, session.elapsed_s())


def _launch_faces(
    config: Config,
    folder: Path,
    stack: ExitStack,
    trial: ShownTrial | None,
    replay: ShownReplay | None,
) -> list[SessionDisplay]:
    """Launch the configured faces, not open yet; none without a display or with --headless."""
    if config.controller.device == "keyboard" and replay is None:
        # whether the arm at the other end of a link is real is known once it answers (`call_robot`)
        require_local_seat(config, not config.rig.enabled, "the desktop")
    if config.headless or not has_display():
        if config.controller.device == "keyboard":
            raise SetupError("--hand keyboard needs the window, and there is no display for it")
        return []
    asked = (FACES[name](config, folder, trial, replay) for name in config.faces)
    faces = [face for face in asked if face is not None]
    for face in faces:
        stack.callback(face.close)
        face.launch()
    return faces


def _show_how_to_begin(session: ShownSession, has_keys: bool, has_window: bool) -> None:
    """Print what a person has to know before the arm may move."""
    hand = words_of_hand(hand_of(session.config))
    if session.config.controller.device == "keyboard":
        session.note(
            "info",
            "press Enter in the window to arm; hold Shift, and W A S D R F move the arm; "
            "Space stops it, F1 lists all keys",
        )
    elif has_keys or has_window:
        button = f" (or hold {hand.confirm} for a second)" if hand.confirm else ""
        session.note(
            "info",
            f"release {hand.deadman} and press Enter{button} to arm; Space stops the arm",
        )
    elif hand.confirm:
        session.note(
            "warning",
            f"there is neither window nor terminal: only {hand.confirm}, held for a second with "
            f"{hand.deadman} released, arms the arm, and Space cannot stop it: keep the emergency "
            "stop button within reach",
        )
    else:
        session.note(
            "warning",
            "there is neither window nor terminal, and what you hold has no button that confirms: "
            "the arm cannot be armed",
        )
    if session.config.recording.episodes:
        session.note(
            "info",
            "episodes: E begins one, and ends and keeps it; Z discards one and U redoes it, each "
            "pressed twice; Y and N label it",
        )
    if not has_window:
        session.note(
            "warning",
            "this computer shows no video: arm only if the operator sees it elsewhere",
        )


def _read_keys(session: ShownSession, stack: ExitStack, trial: ShownTrial | None) -> bool:
    """Act on the terminal's keys from now on; False if there is no terminal to read."""
    presses, clock = defaultdict[Command, KeyPresses](KeyPresses), MonotonicClock()

    def act(command: Command, asked_ns: int) -> None:
        now_ns = clock.now_ns()
        if presses[command].counts(now_ns) or command is Command.EMERGENCY_STOP:
            carry_out(session, trial, command, asked_ns)

    keys = TerminalKeys()
    stack.callback(keys.close)
    keys.open()
    worker = Worker("keys", keys.body(act), lambda _, error: session.fail(str(error)))
    stack.callback(worker.stop)
    worker.start()
    return keys.active
