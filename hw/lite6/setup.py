"""Connecting to a Lite 6: everything that is open between `connect` and `close`, and its checks."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from hw.arm import TcpBoundary
from hw.lite6.codes import Code, Mode, StateCommand
from hw.lite6.commands import activity_of
from hw.lite6.discovery import unfitness
from hw.lite6.errors import error_sentence, standing_error_sentence
from hw.lite6.outbox import Outbox
from hw.lite6.report import STATUS_STALE_NS, ReportReader, read_simulation_flag
from hw.lite6.sdk import connect_sdk, disconnect_sdk, note_mode
from hw.lite6.sender import CommandSender
from hw.lite6.settings import Lite6Settings, accept
from hw.lite6.stop_channel import StopChannel
from tams_app.config import ArmConfig
from tams_app.errors import DeviceError
from tams_app.records import CommandLink, LinkFault, Vector
from tams_app.runtime.clock import Clock
from tams_app.runtime.realtime import copy_scheduling

SETUP_REPLY_TIMEOUT_S = 1.0
REPORT_TIMEOUT_S = 2.0  # ten periods of the normal report
STOP_TIMEOUT_S = 0.5
ERROR_GONE_TIMEOUT_S = 1.0  # five periods of the report that shows it
READY_ACCELERATION_RAD_S2 = 1.0


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
        self.outbox = Outbox()
        with contextlib.ExitStack() as opened:
            self.stop = StopChannel(
                config.host, config.control_port, config.reply_timeout_s, name="arm-stop"
            )
            opened.callback(self.stop.close)
            self._stop_at_once()
            self._others = self._open_others(slow_after_ns)
            self._settings = Lite6Settings(self.api, config, boundary)
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
            self._check_identity()
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
            return link
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
        """Check the error state, then set what belongs to the tool; the arm stays stopped."""
        reports = self.reports
        if not reports.wait_for(self._has_reported, REPORT_TIMEOUT_S):
            raise DeviceError(
                reports.failure or "The arm sends no reports; restart its control box."
            )
        with self.with_setup_timeout():
            self._settings.set_boundary()
        self._raise_standing_error()
        with self.with_setup_timeout():
            self._settings.set()
            accept(self.api.set_state(StateCommand.STOP), "a stop")
        asked_ns = self._clock.now_ns()
        if not reports.wait_for(lambda: self._settings_are_back(asked_ns), REPORT_TIMEOUT_S):
            raise DeviceError(
                reports.failure
                or "The arm did not take its TCP offset or collision sensitivity; "
                "restart its control box."
            )

    def make_ready(self, mode: Mode) -> None:
        """Release the brakes and enter `mode`, as the reports confirm; or DeviceError."""
        link = self.link
        if link.fault is LinkFault.LOST:  # the SDK would wait five seconds for a reply
            raise DeviceError(link.failure)
        self.raise_error()
        with self.with_setup_timeout():
            self._settings.check_boundary()
            accept(self.api.motion_enable(True), "the release of the brakes")
            if not self._settings.load_is_set:
                self._enter(Mode.POSITION)
                self._settings.set_load()
            self._enter(mode)
        asked_ns = self._clock.now_ns()
        if not self.reports.wait_for(lambda: self._is_ready(mode, asked_ns), REPORT_TIMEOUT_S):
            self.raise_error()
            raise DeviceError(
                self.reports.failure
                or f"The arm did not get ready in mode {mode.value} with its settings; "
                "clear errors and try again."
            )

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
        """Clear the controller's error and the link's failure; DeviceError if it persists."""
        self.outbox.shut()
        with self.with_setup_timeout():
            # the reply to these still reports the error: whether it went is seen in the reports
            accept(self.api.clean_error(), "clearing the error", but=Code.ERROR)
            accept(self.api.clean_warn(), "clearing the warning", but=Code.ERROR)
            accept(self.api.set_state(StateCommand.STOP), "a stop")
        asked_ns = self._clock.now_ns()
        reports = self.reports

        def is_clear() -> bool:
            status = reports.status
            return status is not None and status.received_ns > asked_ns and not status.error_code

        if not reports.wait_for(is_clear, ERROR_GONE_TIMEOUT_S):
            self.raise_error()
            raise DeviceError(reports.failure or "The arm sends no reports; confirm once more.")
        self.sender.forget_failure()

    def raise_error(self) -> None:
        """DeviceError if the controller reports one, with what to do about it."""
        status = self.reports.status
        if status is not None and status.error_code:
            raise DeviceError(error_sentence(status.error_code))

    def _raise_standing_error(self) -> None:
        status = self.reports.status
        if status is not None and status.error_code:
            raise DeviceError(standing_error_sentence(status.error_code))

    def _has_reported(self) -> bool:
        return self.reports.motion is not None and self.reports.status is not None

    def _check_identity(self) -> None:
        simulated = read_simulation_flag(self._config.host, self._config.report_port)
        api = self.api
        if problem := unfitness(api.axis, api.device_type, api.version_number, simulated):
            raise DeviceError(problem)

    def _enter(self, mode: Mode) -> None:
        accept(self.api.set_mode(mode), f"mode {mode.value}")
        note_mode(self.api, mode)
        accept(self.api.set_state(StateCommand.READY), "getting ready")

    def _is_ready(self, mode: Mode, since_ns: int) -> bool:
        motion, status = self.reports.motion, self.reports.status
        return (
            motion is not None
            and status is not None
            and min(motion.received_ns, status.received_ns) > since_ns
            and motion.mode == mode
            and not activity_of(motion.state).is_halted
            and status.motors_enabled
            and self._settings_are_back(since_ns)
        )

    def _settings_are_back(self, since_ns: int) -> bool:
        status = self.reports.status
        return (
            status is not None and status.received_ns > since_ns and self._settings.are_in(status)
        )
