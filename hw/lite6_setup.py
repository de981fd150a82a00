"""Connecting to a Lite 6: everything that is open between `connect` and `close`, and its checks."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from hw.lite6_codes import (
    MAY_MOVE,
    Code,
    Mode,
    State,
    controller_error_sentence,
    return_code_sentence,
)
from hw.lite6_outbox import Outbox
from hw.lite6_report import ReportReader, read_simulation_flag
from hw.lite6_sdk import connect_sdk, disconnect_sdk, note_mode
from hw.lite6_sender import CommandSender
from hw.stop_channel import StopChannel
from tams_app.clock import Clock
from tams_app.config import ArmConfig
from tams_app.errors import DeviceError
from tams_app.records import CommandLink

AXES, LITE6_TYPE = 6, 9
MIN_FIRMWARE = (1, 8, 0)  # older ones drop `duration`, the controller's own deadman
SETUP_REPLY_TIMEOUT_S = 1.0
REPORT_TIMEOUT_S = 2.0  # ten periods of the normal report
STOP_TIMEOUT_S = 0.5
_SETTING_TOLERANCE = 1e-3  # mm, rad, kg


def accept(code: int, call: str, but: Code = Code.OK) -> None:
    """DeviceError unless the SDK's return code says that `call` was done, or is `but`."""
    if code not in (Code.OK, Code.WARNING, but):
        raise DeviceError(return_code_sentence(code, call))


class Lite6Connection:
    """The four connections to one arm and the threads on them."""

    def __init__(self, config: ArmConfig, clock: Clock, slow_after_ns: int) -> None:
        """Open them all and stop the arm; DeviceError, with nothing left open, if one fails.

        The stop comes first so that no motion somebody left in the queue can go on when a setting
        makes the controller ready.
        """
        self._config, self._clock = config, clock
        self._load_is_set = False
        self.outbox = Outbox()
        with contextlib.ExitStack() as opened:
            self.stop = StopChannel(
                config.host, config.control_port, config.reply_timeout_s, name="arm-stop"
            )
            opened.callback(self.stop.close)
            self.stop.start()
            self.stop.request_stop()
            if not self.stop.wait_acknowledged(STOP_TIMEOUT_S):
                raise DeviceError(
                    self.stop.failure
                    or "The arm does not acknowledge a stop; restart its control box."
                )
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
            self._closing = opened.pop_all()

    def close(self) -> None:
        """Hang up and end the threads."""
        self._closing.close()

    @property
    def failure(self) -> str:
        """Why the arm cannot be used through these connections, "" if it can."""
        return self.sender.failure or self.stop.failure or self.reports.failure

    @property
    def link(self) -> CommandLink:
        return replace(self.sender.link, failure=self.failure)

    @contextlib.contextmanager
    def patiently(self) -> Iterator[None]:
        """Inside, calls may take as long as setting up takes; a servo may not wait that long."""
        self.api.set_timeout(SETUP_REPLY_TIMEOUT_S)
        try:
            yield
        finally:
            self.api.set_timeout(self._config.reply_timeout_s)

    def configure(self) -> None:
        """Check the error state, then set what belongs to the tool; the arm stays stopped.

        Collision sensitivity moves the controller's state, so it is set here and never later.
        """
        config = self._config
        reports = self.reports
        if not reports.wait_for(lambda: reports.motion is not None, REPORT_TIMEOUT_S):
            raise DeviceError(
                reports.failure or "The arm sends no reports; restart its control box."
            )
        self.raise_error()
        with self.patiently():
            accept(self.api.set_collision_sensitivity(config.collision_sensitivity), "sensitivity")
            accept(self.api.set_self_collision_detection(True), "the self-collision check")
            offset = list(config.tcp_offset_mm_deg)
            accept(self.api.set_tcp_offset(offset, is_radian=False, wait=False), "the TCP offset")
            accept(self.api.set_state(State.STOPPED), "a stop")
        self._await_settings()

    def make_ready(self, mode: Mode) -> None:
        """Release the brakes and enter `mode`, as the reports confirm; or DeviceError."""
        if self.reports.failure:  # the SDK would wait five seconds for a reply to what follows
            raise DeviceError(self.reports.failure)
        self.raise_error()
        with self.patiently():
            accept(self.api.motion_enable(True), "the release of the brakes")
            if not self._load_is_set:
                self._set_load()
            self._enter(mode)
        asked_ns = self._clock.now_ns()
        if not self.reports.wait_for(lambda: self._is_ready(mode, asked_ns), REPORT_TIMEOUT_S):
            self.raise_error()
            raise DeviceError(
                self.reports.failure
                or f"The arm did not get ready in mode {mode.value} with its settings; "
                "clear errors and try again."
            )

    def raise_error(self) -> None:
        """DeviceError if the controller reports one, with what to do about it."""
        status = self.reports.status
        if status is not None and status.error_code:
            raise DeviceError(controller_error_sentence(status.error_code))

    def _check_identity(self) -> None:
        where = f"{self._config.host}:{self._config.control_port}"
        if (self.api.axis, self.api.device_type) != (AXES, LITE6_TYPE):
            raise DeviceError(
                f"The arm at {where} is no Lite 6 (axes {self.api.axis}, type "
                f"{self.api.device_type}); set arm.host to the Lite 6."
            )
        if self.api.version_number < MIN_FIRMWARE:
            raise DeviceError(
                f"The arm's firmware ({self.api.version}) is older than "
                f"{'.'.join(map(str, MIN_FIRMWARE))} and would not stop by itself when commands "
                "cease; update it with UFACTORY Studio."
            )
        if read_simulation_flag(self._config.host, self._config.report_port):
            raise DeviceError(
                f"The arm at {where} only pretends to move; switch its simulation mode off in "
                "UFACTORY Studio."
            )

    def _enter(self, mode: Mode) -> None:
        accept(self.api.set_mode(mode), f"mode {mode.value}")
        note_mode(self.api, mode)
        accept(self.api.set_state(State.READY), "getting ready")

    def _set_load(self) -> None:
        """The controller queues the load like a motion: it takes it only when ready."""
        self._enter(Mode.POSITION)
        centre = list(self._config.tcp_load_centre_mm)
        accept(self.api.set_tcp_load(self._config.tcp_load_kg, centre), "the load")
        self._load_is_set = True

    def _is_ready(self, mode: Mode, since_ns: int) -> bool:
        motion, status = self.reports.motion, self.reports.status
        return (
            motion is not None
            and status is not None
            and min(motion.received_ns, status.received_ns) > since_ns
            and motion.mode == mode
            and motion.state in MAY_MOVE
            and status.motors_enabled
            and self._settings_are_back(since_ns)
        )

    def _await_settings(self) -> None:
        """The settings must come back in a report: a wrong TCP would move the wrong point."""
        asked_ns = self._clock.now_ns()
        if not self.reports.wait_for(lambda: self._settings_are_back(asked_ns), REPORT_TIMEOUT_S):
            raise DeviceError(
                self.reports.failure
                or "The arm did not take its TCP offset or collision sensitivity; "
                "restart its control box."
            )

    def _settings_are_back(self, since_ns: int) -> bool:
        status = self.reports.status
        if status is None or status.received_ns <= since_ns:
            return False
        config = self._config
        wanted_mm, wanted_deg = config.tcp_offset_mm_deg[:3], config.tcp_offset_mm_deg[3:]
        load = (config.tcp_load_kg, *config.tcp_load_centre_mm)
        return (
            _close(status.tcp_offset[:3], wanted_mm)
            and _close(_turns(status.tcp_offset[3:], wanted_deg), (0.0, 0.0, 0.0))
            and status.collision_sensitivity == config.collision_sensitivity
            and (not self._load_is_set or _close(status.load, load))
        )


def _close(values: tuple[float, ...], wanted: tuple[float, ...]) -> bool:
    return all(abs(a - b) <= _SETTING_TOLERANCE for a, b in zip(values, wanted, strict=True))


def _turns(angles_rad: tuple[float, ...], wanted_deg: tuple[float, ...]) -> tuple[float, ...]:
    """Differences [rad] without whole turns."""
    return tuple(
        math.remainder(angle - math.radians(wanted), math.tau)
        for angle, wanted in zip(angles_rad, wanted_deg, strict=True)
    )
