"""Connecting to a Lite 6: everything that is open between `connect` and `close`, and its checks."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from hw.arm import TcpBoundary
from hw.lite6.commands import (
    READY_ACCELERATION_RAD_S2,
    activity_of,
    error_sentence,
    standing_error_sentence,
)
from hw.lite6.protocol import DRIVE_ERRORS, Code, Mode, StateCommand
from hw.lite6.report import STATUS_STALE_NS, MotionReport, ReportReader, StatusReport
from hw.lite6.sdk import connect_sdk, disconnect_sdk, note_mode
from hw.lite6.sender import CommandSender, Outbox
from hw.lite6.settings import Lite6Settings, accept, foreign_refusal, unfitness
from hw.lite6.stop_channel import Lite6StopChannel
from tams_app.config import ArmConfig
from tams_app.errors import DeviceError
from tams_app.records import CommandLink, LinkFault, Vector
from tams_app.runtime.clock import Clock
from tams_app.runtime.realtime import copy_scheduling

SETUP_REPLY_TIMEOUT_S = 1.0
REPORT_TIMEOUT_S = 2.0  # ten periods of the rich report
STOP_TIMEOUT_S = 0.5
ERROR_GONE_TIMEOUT_S = 1.0  # five periods of the report that shows it


class Lite6Connection:
    """The four connections to one arm and the threads on them."""

    def __init__(
        self, config: ArmConfig, clock: Clock, slow_after_ns: int, boundary: TcpBoundary | None
    ) -> None:
        """Open them all and stop the arm; DeviceError, with nothing left open, if one fails.

        The stop comes first so that no motion that another program left in the queue can go on
        when a setting makes the controller ready.
        """
        self._config, self._clock = config, clock
        self._closed = False
        self._is_set_up = False
        self._problem = ""  # with the settings, once it was set up
        self.outbox = Outbox()
        with contextlib.ExitStack() as opened:
            self.stop = Lite6StopChannel(
                config.host, config.control_port, config.reply_timeout_s, name="arm-stop"
            )
            opened.callback(self.stop.close)
            self._stop_at_once()
            self._others = self._open_others(slow_after_ns)
            self._settings = Lite6Settings(self.api, config, boundary)
            self.reports.on_status = self._look_for_changes
            self.reports.on_motion = self._look_for_stop
            opened.pop_all()

    def _stop_at_once(self) -> None:
        self.stop.start()
        self.stop.request_stop()
        if not self.stop.wait_acknowledged(STOP_TIMEOUT_S):
            raise DeviceError(
                self.stop.failure or "The arm does not acknowledge a stop; restart its control box."
            )

    def _open_others(self, slow_after_ns: int) -> contextlib.ExitStack:
        """Reports, SDK and sender, to be closed together."""
        config, clock = self._config, self._clock
        with contextlib.ExitStack() as opened:
            self.reports = ReportReader(config.host, config.report_port, clock)
            opened.callback(self.reports.close)
            self.reports.start()
            self.api: Any = connect_sdk(config.host, config.control_port)
            opened.callback(disconnect_sdk, self.api)
            api = self.api
            if problem := unfitness(api.axis, api.device_type, api.version_number):
                raise DeviceError(problem)
            self.api.set_timeout(config.reply_timeout_s)
            self.sender = CommandSender(
                self.api,
                self.outbox,
                clock,
                config.velocity_deadman_s,
                slow_after_ns,
                self.reports.note_error,
            )
            opened.callback(self.sender.close)
            self.sender.start()
            return opened.pop_all()

    def disconnect(self) -> None:
        """Close all but the stop's connection; from then on the link counts as lost."""
        self._closed = True
        self.outbox.shut()
        self._others.close()

    def close(self) -> None:
        """Disconnect and end the threads; may be called twice."""
        self.disconnect()
        self.stop.close()

    @property
    def link(self) -> CommandLink:
        link = self.sender.link
        lost = self.stop.failure or self.reports.failure
        if link.fault is LinkFault.LOST or not (self._closed or lost):
            if link.failure or not self._problem:
                return link
            return replace(link, failure=self._problem, fault=LinkFault.REFUSED)
        sentence = lost or link.failure or "The arm's connection is closed; connect it anew."
        return replace(link, failure=sentence, fault=LinkFault.LOST)

    @property
    def thread_ids(self) -> dict[str, int]:
        """Kernel ids of the threads between the control loop and the arm, by name."""
        ids = {
            "arm-sender": self.sender.native_id,
            "arm-report": self.reports.native_id,
            "arm-stop": self.stop.native_id,
        }
        return {name: native_id for name, native_id in ids.items() if native_id is not None}

    def take_scheduling(self, before: Lite6Connection) -> None:
        """Schedule these threads as the ones of the connection before, whose stop still runs."""
        if before.stop.native_id is not None:
            copy_scheduling(before.stop.native_id, self.thread_ids.values())

    @property
    def broken(self) -> bool:
        """True if only new connections will help; the stop's recovers by itself."""
        return self._closed or self.sender.link.fault is LinkFault.LOST or not self._reports_come

    @property
    def _reports_come(self) -> bool:
        motion = self.reports.motion
        age_ns = self._clock.now_ns() - motion.received_ns if motion is not None else None
        return not self.reports.failure and age_ns is not None and age_ns < STATUS_STALE_NS

    @contextlib.contextmanager
    def with_setup_timeout(self) -> Iterator[None]:
        """Inside, calls may take as long as setting up takes; a servo may not wait that long."""
        self.api.set_timeout(SETUP_REPLY_TIMEOUT_S)
        try:
            yield
        finally:
            self.api.set_timeout(self._config.reply_timeout_s)

    def configure(self) -> None:
        """Check settings and error state, then set what is TAMS's own; the arm stays stopped."""
        reports = self.reports
        self._is_set_up = False
        if refusal := foreign_refusal(self._next_status()):
            self._problem = refusal
            raise DeviceError(refusal)
        with self.with_setup_timeout():
            self._settings.set_boundary()
        status = reports.status
        if status is not None and status.error_code:
            raise DeviceError(standing_error_sentence(status.error_code))
        with self.with_setup_timeout():
            self._settings.set()
            accept(self.api.set_state(StateCommand.STOP), "a stop")
        if not reports.next_status(REPORT_TIMEOUT_S, lambda now: not self._settings.missing(now)):
            missing = "" if reports.status is None else self._settings.missing(reports.status)
            raise DeviceError(
                reports.failure or f"The arm did not take its {missing}; restart its control box."
            )
        self._is_set_up, self._problem = True, ""

    def make_ready(self, mode: Mode) -> None:
        """Release the brakes and enter `mode`, as the reports confirm; or DeviceError."""
        link = self.link
        if link.fault is LinkFault.LOST:  # the SDK would wait five seconds for a reply
            raise DeviceError(link.failure)
        self.raise_error()
        if not self._is_set_up:
            self.configure()
        if problem := self._settings.problem(self._next_status()):
            raise DeviceError(problem)
        self._is_set_up = False  # what is reported meanwhile may be from before
        with self.with_setup_timeout():
            accept(self.api.motion_enable(True), "the release of the brakes")
            if not self._settings.load_is_set:
                self._enter(Mode.POSITION)
                self._settings.set_load()
            self._enter(mode)
        asked_ns = self._clock.now_ns()
        if not self.reports.next_status(
            REPORT_TIMEOUT_S, lambda status: self._is_ready(mode, status, asked_ns)
        ):
            self.raise_error()
            raise DeviceError(
                self.reports.failure
                or f"The arm did not get ready in mode {mode.value} with its settings; "
                "clear errors and try again."
            )
        self._is_set_up, self._problem = True, ""

    def begin_move(self, goal: Vector, speed: float) -> None:
        """Move the joints to `goal` [rad] at `speed` [rad/s], without waiting; when ready."""
        with self.with_setup_timeout():
            code = self.api.set_servo_angle(
                angle=goal.tolist(),
                speed=speed,
                mvacc=READY_ACCELERATION_RAD_S2,
                is_radian=True,
                wait=False,  # the SDK's own waiting cannot be interrupted
            )
        accept(code, "the move")

    def clear_errors(self) -> None:
        """Clear error and failure, and set up what is not; DeviceError if the error persists."""
        self.outbox.shut()
        status = self.reports.status
        with self.with_setup_timeout():
            if status is not None and status.error_code in DRIVE_ERRORS:
                accept(self.api.motion_enable(True), "the motors anew", but=Code.ERROR)
            # the reply to these still reports the error: whether it went is seen in the reports
            accept(self.api.clean_error(), "clearing the error", but=Code.ERROR)
            accept(self.api.clean_warn(), "clearing the warning", but=Code.ERROR)
            accept(self.api.set_state(StateCommand.STOP), "a stop")
        reports = self.reports
        if not reports.next_status(ERROR_GONE_TIMEOUT_S, lambda now: not now.error_code):
            self.raise_error()
            raise DeviceError(reports.failure or "The arm sends no reports; confirm once more.")
        self.sender.forget_failure()
        if self._problem or not self._is_set_up:
            self.configure()

    def raise_error(self) -> None:
        """DeviceError if the controller reports one, with what to do about it."""
        status = self.reports.status
        if status is not None and status.error_code:
            raise DeviceError(error_sentence(status.error_code, status.drive_codes))

    def _next_status(self) -> StatusReport:
        status = self.reports.next_status(REPORT_TIMEOUT_S)
        if status is None:
            raise DeviceError(
                self.reports.failure or "The arm sends no reports; restart its control box."
            )
        return status

    def _look_for_changes(self, before: StatusReport, status: StatusReport) -> None:
        """What events and other programs change while the arm is used."""
        failed = status.error_code and not before.error_code
        if failed or (before.motors_enabled and not status.motors_enabled):
            self.sender.doubt_gripper()
        if self._is_set_up:
            self._problem = self._settings.problem(status)
            if self._problem:
                self.outbox.shut()

    def _look_for_stop(self, before: MotionReport, motion: MotionReport) -> None:
        """A stop switches the gripper's outputs off where another program has set that."""
        status, is_new = self.reports.status, motion.state != before.state
        if is_new and activity_of(motion.state).is_halted and status and status.clears_outputs:
            self.sender.doubt_gripper()

    def _enter(self, mode: Mode) -> None:
        accept(self.api.set_mode(mode), f"mode {mode.value}")
        note_mode(self.api, mode)
        accept(self.api.set_state(StateCommand.READY), "getting ready")

    def _is_ready(self, mode: Mode, status: StatusReport, since_ns: int) -> bool:
        motion = self.reports.motion
        return (
            motion is not None
            and motion.received_ns > since_ns
            and motion.mode == mode
            and not activity_of(motion.state).is_halted
            and status.motors_enabled
            and not self._settings.problem(status)
        )
