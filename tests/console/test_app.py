"""What `run` tells a person at the hardware before the arm may move, and the keys it reads."""

import io
import os
import pty
import queue
import signal
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, contextmanager
from types import SimpleNamespace

import pytest

from tams_app.config import CONFIG_DIRECTORY, load_config
from tams_app.console import app, end_screen, report
from tams_app.errors import SignalledError, TamsError
from tams_app.faces.commands import Command
from tams_app.faces.terminal.keys import TerminalKeys
from tams_app.printing import Console
from tams_app.robot.control import CONFIRMED_AGO_NS, Signals
from tams_app.runtime.mailbox import Sentences
from tams_app.runtime.process import PROJECT_DIRECTORY
from tams_app.station.fresh_video import Displays
from tams_app.teleop.hands import HANDS
from tams_app.units import NS_PER_S

pytestmark = pytest.mark.waiting


class EndedSession:
    """A session on the configured devices that is over at the first look."""

    folder = None

    def __init__(self, name, hand="auto"):
        overrides = {"headless": True, "controller.device": hand}
        self.config = load_config(CONFIG_DIRECTORY / name, overrides)
        self.sentences = Sentences()
        self.signals = Signals()
        self.displays = Displays()
        self.ended = SimpleNamespace(wait=lambda seconds: True)
        self.notes = []

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self.close()

    def start(self):
        """Nothing has to be started."""

    def close(self):
        """Nothing has to be ended."""

    def note(self, level, text):
        self.notes.append((level, text))

    def elapsed_s(self):
        return 0.0

    def stop_arm(self):
        """Nothing moves."""


def keys(active):
    return lambda _session, _stack, _trial: active


@pytest.fixture
def told(monkeypatch):
    def tell(name, active, hand="auto"):
        monkeypatch.setattr(app, "_read_keys", keys(active))
        session = EndedSession(name, hand)
        app._watch(session, Console(quiet=True))
        return session.notes

    return tell


def test_at_the_end_no_face_waits_for_anything_but_the_arm(monkeypatch):
    """A window that stays open longer says NOT LIVE in an ordinary end."""
    ended = []

    def read(session: object, stack: ExitStack, trial: object) -> bool:
        stack.callback(ended.append, "keys")
        return True

    monkeypatch.setattr(app, "_read_keys", read)
    session = EndedSession("lite6.yaml")
    session.stop_arm = lambda: ended.append("arm")
    face = SimpleNamespace(open=lambda _session: None, close=lambda: ended.append("face"))
    app._watch(session, Console(quiet=True), faces=[face])
    assert ended == ["arm", "face", "keys"]


def test_at_the_hardware_the_operator_is_told_how_to_arm_and_what_is_missing(told):
    (level, text), (video, no_video) = told("lite6.yaml", active=True)
    assert level == "info"
    assert text.startswith("release the trigger and press Enter (or hold the menu button")
    assert video == "warning"
    assert "shows no video" in no_video
    (level, text), _ = told("lite6.yaml", active=False)
    assert level == "warning"
    assert "only the menu button" in text
    assert "Space cannot stop" in text
    assert told("tams.yaml", active=False) == [], "the rig needs no instructions"


def test_what_arms_the_arm_is_told_in_the_words_of_what_the_operator_holds(told, monkeypatch):
    monkeypatch.setitem(HANDS, "pedal", HANDS["keyboard"])  # as another distribution does
    (_, text), _ = told("tams.yaml", active=True, hand="pedal")
    assert text.startswith("release Shift and press Enter to arm")
    (level, text), _ = told("tams.yaml", active=False, hand="pedal")
    assert level == "warning"
    assert "cannot be armed" in text


def test_without_a_terminal_no_keys_are_read(monkeypatch):
    monkeypatch.setattr("os.isatty", lambda fd: False)
    session = EndedSession("tams.yaml")
    session.end = session.fail = lambda reason: None
    with ExitStack() as stack:
        assert not app._read_keys(session, stack, None)


class InterruptedSession(EndedSession):
    """A session during whose start Ctrl-C is pressed."""

    def __init__(self):
        super().__init__("tams.yaml")
        self.asked = []
        self.was_asked = threading.Event()

    def start(self):
        os.kill(os.getpid(), signal.SIGINT)
        assert self.was_asked.wait(10), "signals end a session from a thread of their own"

    def request_end(self, reason):
        self.asked.append(reason)
        self.was_asked.set()

    def close(self):
        self.asked.append("closed")


def test_who_runs_a_session_is_told_of_the_signal_that_ends_it(monkeypatch):
    monkeypatch.setattr(app, "_read_keys", keys(False))
    session, told = InterruptedSession(), []
    app.show_session(session, session, Console(quiet=True), signals=told)
    assert told == ["ended by SIGINT"]
    assert session.asked == ["ended by SIGINT", "closed"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGUSR1])
def test_a_stop_by_signal_that_raises_fails_the_session_and_the_next_signal_counts_too(
    number, monkeypatch
):
    session, failures, found = InterruptedSession(), queue.Queue(), []

    def refuse():
        if threading.current_thread().name == "signals":
            raise OSError("no answer")

    def watch(*_arguments):
        for _ in range(2):
            os.kill(os.getpid(), number)
            found.append(failures.get(timeout=10))

    monkeypatch.setattr(app, "_watch", watch)
    session.stop_arm = session.signals.estop = refuse

    def fail(sentence):
        failures.put(sentence)
        raise OSError("no answer, again")  # as the real one does, whose signals stop the arm

    session.start, session.fail = (lambda: None), fail
    app.show_session(session, session, Console(quiet=True))
    assert found == ["signals: OSError('no answer')"] * 2


LOADS = """
import os, sys
from tams_app.cli import main

class Late:
    def find_spec(self, name, path, target=None):
        if name == "tams_app.console.app":
            os.write(1, b"loading\\n")  # past what has not been written out
            os._exit(0)

sys.meta_path.insert(0, Late())
main()
"""


@pytest.mark.parametrize(
    "command",
    [
        ["run", "--sim", "--headless"],
        ["robot", "--sim", "--listen", "127.0.0.1:7300"],
        ["operate", "--sim", "--robot", "127.0.0.1:7300"],
    ],
)
def test_the_first_line_comes_before_anything_of_a_session_is_loaded(command):
    done = subprocess.run(
        [sys.executable, "-c", LOADS, *command],
        cwd=PROJECT_DIRECTORY,
        capture_output=True,
        text=True,
        timeout=100,
        check=True,
    )
    first, second = done.stdout.splitlines()
    assert first == "loading …"
    assert second == "loading"


def test_after_the_session_it_is_told_that_it_ends_before_it_is_closed(monkeypatch):
    monkeypatch.setattr(app, "_read_keys", keys(False))
    output = io.StringIO()
    session = EndedSession("tams.yaml")
    session.start = lambda: output.write("started\n")
    session.close = lambda: output.write("closed\n")
    app.show_session(session, session, Console(file=output))
    assert output.getvalue().splitlines() == ["started", "ending …", "closed"]


class NotedSession:
    """Notes what the keys ask of it."""

    def __init__(self):
        self.confirmed_ago_ns: list[int] = []
        self.notes: list[str] = []
        self.ended = threading.Event()
        self.failure = ""
        self.signals = SimpleNamespace(
            confirm=self._confirm, estop=lambda: None, episode=lambda _request: None
        )

    def _confirm(self, asked_ns):
        self.confirmed_ago_ns.append(time.monotonic_ns() - asked_ns)

    def note(self, level, text):
        self.notes.append(text)

    def end(self, reason):
        self.ended.set()

    def fail(self, sentence):
        self.failure = sentence


@pytest.fixture
def typed(monkeypatch):
    """Reads the keys of a terminal for a session until it has ended; what is typed there first."""
    operator, program = pty.openpty()
    monkeypatch.setattr(app, "TerminalKeys", lambda: TerminalKeys(program))

    def read(session, *typed, trial=None):
        with ExitStack() as stack:
            assert app._read_keys(session, stack, trial)
            for keys in typed:
                os.write(operator, keys)
                time.sleep(0.5 if len(typed) > 1 else 0)
            assert session.ended.wait(20)
        assert session.failure == ""

    yield read
    os.close(operator)
    os.close(program)


def test_in_a_trial_the_terminal_counts_drops_too(typed):
    marked = []
    trial = SimpleNamespace(mark=marked.append)
    typed(NotedSession(), b"xxxpq", trial=trial)
    assert marked == [Command.DROP, Command.PLACED], "a held key counts one"


def test_a_held_enter_confirms_once(typed):
    session = NotedSession()
    typed(session, b"\r" * 20 + b"\n\nq")
    assert len(session.confirmed_ago_ns) == 1


def test_an_enter_that_was_typed_while_the_session_stood_still_has_its_age(typed):
    session = NotedSession()
    late_s = 0.5 + CONFIRMED_AGO_NS / NS_PER_S
    session.signals.estop = lambda: time.sleep(late_s)
    typed(session, b" ", b"\rq")  # by the second the keys are not looked at
    (ago_ns,) = session.confirmed_ago_ns
    assert ago_ns > CONFIRMED_AGO_NS


class FailedSession(EndedSession):
    """A session that fails when it has started, or before."""

    failure = ""

    def __init__(self, started, sentence):
        super().__init__("tams.yaml")
        self.started, self.sentence = started, sentence

    def start(self):
        raise TamsError(self.sentence)


@pytest.mark.parametrize(
    ("is_made", "started", "sentence", "stays"),
    [
        (True, False, "no arm", False),
        (False, False, "no arm", False),
        (True, True, "ended", True),
        (True, False, "ended; see {folder}/helpers/x.log", True),  # what a sentence points at
    ],
)
def test_a_session_that_did_not_start_leaves_no_folder_but_what_it_recorded_or_points_at(
    tmp_path, is_made, started, sentence, stays
):
    config = load_config(None, {"recording.directory": str(tmp_path), "headless": True})

    def make(folder):
        assert (folder / "config.yaml").exists()
        if not is_made:
            raise TamsError(sentence)
        session = FailedSession(started, sentence.format(folder=folder))
        return session, session

    with pytest.raises(TamsError, match=sentence.partition(";")[0]):
        app.run_and_report(config, make)
    assert [(folder / "config.yaml").exists() for folder in tmp_path.iterdir()] == [True] * stays


@pytest.mark.parametrize(("name", "repeats"), [("tams.yaml", True), ("lite6.yaml", False)])
def test_only_a_session_of_the_rig_may_be_started_anew_from_its_window(name, repeats, monkeypatch):
    asked = []

    def run_and_report(config, make, may_repeat):
        asked.append(may_repeat)

    monkeypatch.setattr(app, "run_and_report", run_and_report)
    monkeypatch.setattr(app, "check_session", lambda config, dry_run, memory_bytes: None)
    app.run_session(load_config(CONFIG_DIRECTORY / name, {}), arm_at_once=False)
    assert asked == [repeats]


@pytest.fixture
def ran(monkeypatch):
    """Runs sessions that are over at once; the answers at their ends, and the folders of all."""

    def run(answers, came=(), may_repeat=True, **overrides):
        left, folders = list(answers), []
        monkeypatch.setattr(app, "create_session_folder", lambda config: f"folder {len(folders)}")
        monkeypatch.setattr(report, "report_session", lambda folder, console: {})
        monkeypatch.setattr(end_screen, "ask_at_end", lambda *given: left.pop(0))

        def make(folder):
            folders.append(folder)
            return SimpleNamespace(failure="", started=True), None

        @contextmanager
        def showing(outset, opening, console, signals, shows_end):
            signals += came
            yield ()

        monkeypatch.setattr(app, "showing", showing)
        config = load_config(CONFIG_DIRECTORY / "tams.yaml", overrides)
        app.run_and_report(config, make, may_repeat=may_repeat)
        return folders

    return run


@pytest.mark.parametrize("answers", [(False,), (True, False)])
def test_a_session_is_run_for_as_long_as_the_operator_asks_for_another(answers, ran):
    assert ran(answers) == [f"folder {number}" for number in range(len(answers))]


def test_a_session_that_is_limited_or_was_interrupted_asks_nobody_at_its_end(ran):
    assert ran((), seconds=30) == ["folder 0"]
    with pytest.raises(SignalledError):
        ran((), came=["ended by SIGINT"])
