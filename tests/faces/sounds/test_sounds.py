"""The operator hears that the arm holds, that there is a fault, and that it is ready again."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tams_app.config import load_config
from tams_app.console import app
from tams_app.faces.registry import FACES
from tams_app.faces.sounds.session_sounds import DEVICE, SessionSounds
from tams_app.faces.sounds.tones import FAULT, HOLD, READY_AGAIN, TONES, Tone, ToneChoice
from tams_app.records import LINK_LOST, SessionState
from tams_app.session.robot import for_robot

pytestmark = pytest.mark.waiting

RATE_HZ = 48_000
DEADLINE_S = 30.0


class Arm:
    """A session whose arming state the test sets."""

    def __init__(self, folder: Path, **overrides: Any) -> None:
        self.folder = folder
        self.config = load_config(None, {"headless": True} | overrides)
        self.arming = "starting"
        self.notes: list[tuple[str, str]] = []

    def state(self) -> SessionState:
        return SessionState(t_s=0.0, arming=self.arming)

    def note(self, level: str, text: str) -> None:
        self.notes.append((level, text))


def tones_of(*states: str) -> list[str | None]:
    choice = ToneChoice()
    return [choice.step(arming) for arming in states]


def test_each_stop_has_one_tone_and_readiness_is_heard_only_after_a_stop() -> None:
    assert tones_of("starting", "disarmed", "ready", "engaged", "ready", "engaged") == [None] * 6
    assert tones_of("engaged", "holding", "holding", "ready", "ready") == [
        *(None, HOLD, None),
        *(READY_AGAIN, None),
    ]
    assert tones_of("holding", "fault", "fault", "disarmed", "ready", "engaged") == [
        *(HOLD, FAULT, None),
        *(None, READY_AGAIN, None),
    ]
    assert tones_of(LINK_LOST, "holding", "ready", "holding") == [HOLD, None, READY_AGAIN, HOLD]


def test_no_two_tones_are_alike() -> None:
    for of in (lambda one: one.hz, lambda one: one.ms, lambda one: one.wave):
        assert len({of(tone) for tone in TONES.values()}) == len(TONES)


def heard(path: Path) -> NDArray[np.int16]:
    return np.frombuffer(path.read_bytes(), np.int16) if path.exists() else np.empty(0, np.int16)


def pitch_hz(samples: NDArray[np.int16]) -> float:
    spectrum = np.abs(np.fft.rfft(samples))
    return float(np.fft.rfftfreq(len(samples), 1 / RATE_HZ)[np.argmax(spectrum)])


def samples_of(tone: Tone) -> int:
    return tone.ms * RATE_HZ // 1000


def test_hold_fault_and_ready_again_are_played_once_each_and_nothing_else(tmp_path: Path) -> None:
    tape = tmp_path / "tape"
    sink = f"audio/x-raw,format=S16LE ! filesink append=true buffer-mode=unbuffered location={tape}"
    arm: Any = Arm(tmp_path)
    sounds = SessionSounds(arm, sink)
    sounds.launch()
    sounds.open()
    played = 0
    try:
        for arming, word in (
            ("ready", None),
            ("engaged", None),
            ("holding", HOLD),
            ("fault", FAULT),
            ("disarmed", None),
            ("ready", READY_AGAIN),
        ):
            arm.arming = arming
            for _ in range(3):
                sounds.refresh()
            if word is None:
                time.sleep(0.1)
                assert len(heard(tape)) == played
                continue
            wanted, deadline_s = played + samples_of(TONES[word]), time.monotonic() + DEADLINE_S
            while len(heard(tape)) < wanted:
                assert time.monotonic() < deadline_s, (word, arm.notes)
                time.sleep(0.02)
            assert pitch_hz(heard(tape)[played:wanted]) == pytest.approx(TONES[word].hz, abs=5)
            played = wanted
    finally:
        sounds.close()
        sounds.close()
    assert len(heard(tape)) == played
    assert arm.notes == []


@pytest.mark.parametrize(
    "sink",
    [
        f"{DEVICE} filter-caps=video/x-raw",  # no device for sound takes that
        "filesink location=/nowhere/tape",
        "nosuchsink",
    ],
)
def test_a_computer_without_sound_says_so_once_and_the_session_goes_on(
    tmp_path: Path, sink: str
) -> None:
    arm: Any = Arm(tmp_path)
    sounds = SessionSounds(arm, sink)
    sounds.launch()
    sounds.open()
    deadline_s = time.monotonic() + DEADLINE_S
    while not arm.notes:
        assert time.monotonic() < deadline_s
        time.sleep(0.02)
    for arm.arming in ("holding", "ready", "fault") * 3:
        sounds.refresh()
    sounds.close()
    ((level, text),) = arm.notes
    assert level == "warning"
    assert text.startswith("no sound can be played here: ")
    assert text.endswith("; the session goes on without sounds")


def test_a_process_that_ends_unasked_is_noted_once_and_the_session_goes_on(tmp_path: Path) -> None:
    arm: Any = Arm(tmp_path)
    sounds = SessionSounds(arm, "fakesink")
    sounds.launch()
    sounds.open()
    deadline_s = time.monotonic() + DEADLINE_S
    while not sounds._plays:
        assert time.monotonic() < deadline_s, arm.notes
        time.sleep(0.02)
    sounds.refresh()
    assert arm.notes == []
    os.kill(sounds._process.pid or 0, signal.SIGKILL)
    while not arm.notes:
        assert time.monotonic() < deadline_s
        time.sleep(0.02)
        sounds.refresh()
    for arm.arming in ("holding", "ready", "fault") * 3:
        sounds.refresh()
    sounds.close()
    assert arm.notes == [
        ("warning", "the sounds' process ended unasked; the session goes on without sounds")
    ]


def test_a_session_that_ends_at_once_says_nothing_of_sounds(tmp_path: Path) -> None:
    arm: Any = Arm(tmp_path)
    sounds = SessionSounds(arm, "fakesink")
    sounds.launch()
    sounds.open()
    sounds.close()
    assert arm.notes == []


def test_a_sound_system_that_stands_still_holds_nothing_up(tmp_path: Path) -> None:
    arm: Any = Arm(tmp_path)
    sounds = SessionSounds(arm, "fakesink")
    sounds.launch()
    sounds.open()
    os.kill(sounds._process.pid or 0, signal.SIGSTOP)
    begun_s = time.monotonic()
    for arm.arming in ("holding", "ready") * 100:
        sounds.refresh()
    assert time.monotonic() - begun_s < 0.5
    sounds.close()
    assert time.monotonic() - begun_s < 5.0


def launched(session: Any, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The words of the faces that a session without a display launches."""
    made: list[str] = []

    class Made:
        def __init__(self, name: str) -> None:
            self.name = name

        def launch(self) -> None:
            made.append(self.name)

        def close(self) -> None: ...

    class Faces(dict[str, Any]):
        def __missing__(self, name: str) -> Any:
            assert name in FACES
            return lambda *_: Made(name)

    monkeypatch.setattr(app, "FACES", Faces())
    stack = SimpleNamespace(callback=lambda _: None)
    app._launch_faces(session, stack, None, None)  # type: ignore[arg-type]
    return made


def test_sounds_are_off_unless_asked_for_and_need_no_display(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert launched(Arm(tmp_path), monkeypatch) == []
    asked = Arm(tmp_path, faces=("window", "sounds"))
    assert launched(asked, monkeypatch) == ["sounds"]


def test_the_robots_side_is_silent_for_its_operator_is_elsewhere() -> None:
    asked = load_config(None, {"faces": ("window", "sounds")})
    assert for_robot(asked).faces == ()


def test_a_replay_is_silent(tmp_path: Path) -> None:
    arm: Any = Arm(tmp_path)
    replay: Any = object()
    assert FACES["sounds"](arm, None, replay) is None
