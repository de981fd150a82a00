"""The hardware profile, driven for real; faked is only what lies beyond the wire.

The arm is the controller model behind TCP, SteamVR the function tables of a scripted runtime, the
cameras GStreamer's test pattern.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from hw.sim.controller.model import IdealPlant
from hw.sim.controller.server import ControllerServer
from tams_app.config import CONFIG_DIRECTORY, Config, load_config
from tams_app.recording import read_log
from tams_app.records import Vector
from tams_app.runtime.clock import MonotonicClock
from tams_app.session.folder import create_session_folder
from tams_app.session.session import Session
from tests.faults.wire import TappedModel
from tests.hw.openvr.fake_openvr import RIGHT, FakeRuntime

PATIENCE_S = 60.0
AGAIN_S = 0.5  # then the operator tries once more
HIGH_M = 0.28  # from here down again

pytestmark = [
    pytest.mark.timed,
    pytest.mark.usefixtures("real_time"),
    pytest.mark.timeout(300),
]
HAND_M_S = 0.15


class Station:
    """A lab's station with a session running on it."""

    def __init__(self, session: Session, model: TappedModel, runtime: FakeRuntime) -> None:
        self.session, self.model, self.runtime = session, model, runtime
        self._hand_m = 0.0
        self._last_s = time.monotonic()
        self.speed_m_s = 0.0

    def until(self, holds: Callable[[], bool], what: str) -> None:
        """Let the hand go on, trembling as hands do, until `holds`."""
        give_up_s = time.monotonic() + PATIENCE_S
        while not holds():
            assert time.monotonic() < give_up_s, f"not {what}, but {self.session.snapshot()}"
            assert not self.session.ended.is_set(), self.session.failure
            self.session.poll()
            self.move()
            time.sleep(0.004)

    def move(self) -> None:
        now_s = time.monotonic()
        self._hand_m += self.speed_m_s * (now_s - self._last_s)
        self._last_s = now_s
        tremor_m = 1e-5 * np.sin(40.0 * now_s)
        self.runtime.devices[RIGHT].put((0.1 + tremor_m, 1.0 + self._hand_m, -0.3))

    @property
    def arming(self) -> str:
        return self.session.snapshot().arming

    def confirm_until(self, holds: Callable[[], bool], what: str) -> None:
        """Confirm again and again: while the devices are being found one may not count."""
        next_s = 0.0

        def confirmed() -> bool:
            nonlocal next_s
            if holds():
                return True
            if time.monotonic() >= next_s:
                next_s = time.monotonic() + AGAIN_S
                self.session.signals.confirm()
            return False

        self.until(confirmed, what)

    def make_ready(self) -> None:
        self.confirm_until(lambda: self.arming == "ready", "ready")

    def engages(self) -> bool:
        """Press the trigger, and anew if something was in the way just then; False at a fault."""
        next_s, pressed = 0.0, False

        def engaged() -> bool:
            nonlocal next_s, pressed
            if pressed and self.arming == "engaged":
                return True
            if time.monotonic() >= next_s:
                next_s = time.monotonic() + AGAIN_S
                pressed = not pressed
                self.runtime.press("trigger", 1.0 if pressed else 0.0)
            return False

        self.until(lambda: engaged() or self.arming == "fault", "engaged")
        return self.arming == "engaged"

    def release(self) -> bool:
        """Let go of the trigger with the hand at rest; False if that ends in a fault."""
        self.speed_m_s = 0.0
        self.runtime.press("trigger", 0.0)
        self.until(lambda: self.arming in ("ready", "fault"), "ready again")
        return self.arming == "ready"


def hardware(tmp_path: Path, control_port: int, report_port: int) -> Config:
    pattern = {"source": "pattern"}
    return load_config(
        CONFIG_DIRECTORY / "lite6.yaml",
        {
            "arm.host": "127.0.0.1",
            "arm.control_port": control_port,
            "arm.report_port": report_port,
            "arm.reply_timeout_s": 0.5,  # all ends share one busy process here
            "freshness.arm_reply_ms": 2000,
            "freshness.arm_state_ms": 2000,
            "freshness.pose_frozen_ms": 2000,
            "freshness.buttons_ms": 2000,
            "freshness.video_slow_ms": 4900,
            "freshness.video_hold_ms": 5000,
            "arm.velocity_deadman_s": 0.9,
            "arm.guard.heartbeat_timeout_ms": 1000,
            "cameras": {"eih": pattern, "gt": pattern, "gs": pattern},
            "video.fps": 10,  # application, controller and three cameras share one interpreter
            "video.quality.enabled": False,
            "recording.directory": str(tmp_path),
            "control.realtime_priority": 0,
            "headless": True,
        },
    )


@contextmanager
def station(
    tmp_path: Path, dry_run: bool = False, joints: Vector | None = None
) -> Iterator[Station]:
    """`joints` [rad]: where the arm stands; None: at its ready pose."""
    ready = np.radians(load_config(CONFIG_DIRECTORY / "lite6.yaml").arm.ready_joints_deg)
    model = TappedModel(IdealPlant(), start_joints=ready if joints is None else joints)
    server, runtime = ControllerServer(model), FakeRuntime()
    server.start()
    try:
        config = hardware(tmp_path, server.ports.control, server.ports.report)
        with runtime.in_place_of_the_library():
            folder = create_session_folder(config)
            session = Session(config, MonotonicClock(), folder, dry_run=dry_run)
            session.start()
            try:
                yield Station(session, model, runtime)
            finally:
                session.close()
    finally:
        server.close()


def drive(here: Station) -> float:
    """Arm, press, raise the hand, release; how far [m] the arm reports to have followed."""
    here.until(lambda: here.session.snapshot().views["eih"].shown_age_ms is not None, "a frame")
    here.make_ready()
    before = tcp_height(here)
    assert here.engages(), here.session.snapshot()
    here.speed_m_s = HAND_M_S if before < HIGH_M else -HAND_M_S
    here.until(
        lambda: abs(tcp_height(here) - before) > 0.02 or here.arming != "engaged", "the arm follows"
    )
    followed = abs(tcp_height(here) - before)
    assert here.release(), here.session.snapshot()
    return followed


def tcp_height(here: Station) -> float:
    tcp_mm = here.session.snapshot().tcp_mm
    assert tcp_mm is not None
    return tcp_mm[2] / 1000.0


def test_a_hand_in_steamvr_moves_a_lite6_and_three_cameras_are_streamed(tmp_path: Path) -> None:
    with station(tmp_path) as here:
        assert drive(here) > 0.02
        here.session.end("ended by the operator")
    log = read_log(here.session.folder / "session.mcap")
    assert here.session.failure == ""
    told = [request for request in here.model.wire if request.is_motion or request.is_stop]
    assert any(request.is_motion for request in told)
    assert told[-1].is_stop
    assert log.outcome is not None
    assert (log.outcome.completed, log.outcome.reason) == (None, "ended by the operator")
    assert {shown.view for shown in log.shown} == {"eih", "gt", "gs"}


def test_a_dry_run_does_everything_but_move_the_arm(tmp_path: Path) -> None:
    with station(tmp_path, dry_run=True) as here:
        assert drive(here) > 0.02  # of the model
        here.session.end("ended by the operator")
    assert here.session.failure == ""
    assert not [request for request in here.model.wire if request.is_motion]
    assert not here.model.enabled


def test_a_runtime_that_quits_stops_the_arm_and_says_so(tmp_path: Path) -> None:
    with station(tmp_path) as here:
        here.until(lambda: here.session.snapshot().views["eih"].shown_age_ms is not None, "a frame")
        here.make_ready()
        sent = len(here.model.wire)
        here.runtime.quit()
        here.until(lambda: here.arming == "fault", "a fault")
        assert "VR runtime quit" in here.session.snapshot().reason
        here.until(lambda: any(r.is_stop for r in here.model.wire[sent:]), "state 4")


@pytest.mark.parametrize("dry_run", [False, True])
def test_an_arm_at_the_factorys_home_is_sent_home_and_not_enabled(
    tmp_path: Path, dry_run: bool
) -> None:
    with station(tmp_path, dry_run, np.zeros(6)) as here:
        told: list[str] = []

        def refused() -> bool:
            told.extend(here.session.board.take_notes())
            return any("outside the workspace" in note for note in told)

        here.confirm_until(refused, "a refusal")
        assert here.arming == "disarmed"
        assert not here.model.enabled
    sentence = next(note for note in told if "outside the workspace" in note)
    assert sentence.endswith("run `run_tams.py home` first")


@pytest.mark.parametrize("missing", ["arm", "controller"])
def test_a_missing_device_is_one_sentence_and_nothing_is_left_behind(
    tmp_path: Path, missing: str
) -> None:
    from tams_app.errors import TamsError

    model = TappedModel(IdealPlant())
    server, runtime = ControllerServer(model), FakeRuntime()
    server.start()
    config = hardware(tmp_path, server.ports.control, server.ports.report)
    if missing == "arm":
        server.close()
    else:
        runtime.die()
    try:
        with runtime.in_place_of_the_library(), pytest.raises(TamsError) as refusal:
            Session(config, MonotonicClock(), create_session_folder(config)).start()
    finally:
        server.close()
    assert len(str(refusal.value).splitlines()) == 1
