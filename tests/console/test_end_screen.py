"""The end of a session on the screen: what it says, and what its answers do."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tams_app.config import CONFIG_DIRECTORY, load_config
from tams_app.console import end_screen
from tams_app.console.end_screen import ask_at_end, end_of
from tams_app.faces.commands import Command
from tams_app.faces.messages import Ended
from tams_app.faces.registry import SessionDisplay
from tams_app.printing import Console

pytestmark = pytest.mark.untimed

FOLDER = Path("/logs/20260101-120000-run")
STOPS = [{"t_s": 12.1, "reason": "stale video", "stop_time_ms": 41.0}]


def summary(completed: bool | None = True, stops: list[dict[str, Any]] | None = None) -> Any:
    outcome = {
        "completed": completed,
        "success": completed,
        "completion_time_s": 34.5 if completed else None,
        "drops": 0,
        "reason": "placed",
    }
    return {
        "outcome": outcome,
        "duration_s": 48.2,
        "arm": {"stops": STOPS if stops is None else stops},
    }


def ended(**changes: Any) -> Ended:
    given = {"summary": summary(), "failure": "", "may_repeat": True, "arguments": ["tams", "run"]}
    values = given | changes
    return end_of(
        values["summary"], FOLDER, values["failure"], values["may_repeat"], values["arguments"]
    )


def test_it_has_the_result_the_stops_with_their_reasons_and_where_the_report_is() -> None:
    end = ended()
    assert end.headline == "Completed in 34.5 s, drops: 0, success"
    assert end.lines == (
        "Ended: placed",
        "Stop at 12.1 s: stale video, at rest after 41 ms",
        f"Report: {FOLDER}/report.html",
    )
    assert end.key == "Enter: start again · Q: close"
    failed = ended(summary=summary(False, []))
    assert failed.headline == "Not completed, drops: 0"
    assert failed.lines[0].startswith("Ended after 48.2 s: ")
    assert "The arm has not been stopped." in ended(summary=summary(True, [])).lines


def test_a_row_of_episodes_has_how_many_were_kept() -> None:
    episodes = [{"kept": True}, {"kept": False}]
    assert ended(summary=summary() | {"episodes": episodes}).headline == (
        "1 episode kept, 1 discarded"
    )


def test_what_cannot_be_started_from_the_window_has_the_command_to_start_it_again() -> None:
    end = ended(may_repeat=False, arguments=["/x/run_tams.py", "run", "--config", "my arm.yaml"])
    assert end.lines[-1] == "To start again: run_tams.py run --config 'my arm.yaml'"
    assert end.key == "Q: close"


def test_a_session_that_has_failed_says_so_and_where_its_log_is() -> None:
    end = ended(summary=None, failure="the arm is gone", may_repeat=False)
    assert end.headline == "The session has failed"
    assert end.lines[:2] == ("It failed: the arm is gone", f"Log: {FOLDER}")


class Screen(SessionDisplay):
    """A face that is answered at once."""

    is_there = True

    def __init__(self, answer: Command | None, is_there: bool = True) -> None:
        self.is_there = is_there
        self.shown: list[Ended] = []
        self._answer = answer

    def show_end(self, end: Ended) -> None:
        self.shown.append(end)
        self.answer = self._answer


def asked(
    screen: Screen,
    hand: str = "keyboard",
    failure: str = "",
    signals: tuple[str, ...] = (),
    may_repeat: bool = True,
) -> bool:
    console = Console(file=io.StringIO())
    config = load_config(CONFIG_DIRECTORY / "tams.yaml", {"controller.device": hand})
    return ask_at_end([screen], console, config, failure, summary(), FOLDER, signals, may_repeat)


def test_enter_starts_a_session_of_the_rig_anew_and_q_or_the_window_s_close_ends_it() -> None:
    assert asked(Screen(Command.CONFIRM))
    assert not asked(Screen(Command.QUIT))
    assert not asked(Screen(Command.CLOSE))


def test_neither_what_cannot_be_repeated_nor_a_session_that_failed_is_started_by_a_key() -> None:
    for failure, may_repeat in (("", False), ("the arm is gone", True)):
        screen = Screen(Command.CONFIRM)
        assert not asked(screen, failure=failure, may_repeat=may_repeat)
        assert screen.shown[0].key == "Q: close"


def test_nobody_is_asked_without_a_window_or_once_a_signal_has_come() -> None:
    gone = Screen(Command.CONFIRM, is_there=False)
    assert not asked(gone)
    assert gone.shown == []
    assert not asked(Screen(Command.CONFIRM), signals=("ended by SIGINT",))


def test_a_simulated_operator_s_end_is_shown_for_a_minute_only(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    passed_s = [0.0]
    monkeypatch.setattr(end_screen.time, "monotonic", lambda: passed_s[0])
    sleep: Callable[[float], None] = lambda _s: passed_s.__setitem__(0, passed_s[0] + 10.0)  # noqa: E731
    monkeypatch.setattr(end_screen.time, "sleep", sleep)
    assert not asked(Screen(None), hand="auto")
    assert passed_s[0] == 60.0
