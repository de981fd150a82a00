"""The UFACTORY Lite 6 behind the arm interface, through UFACTORY's SDK.

Threads: `arm-sender` (commands and their replies, hw/lite6/sender.py), `arm-report` (states,
hw/lite6/report.py) and `arm-stop` (hw/lite6/stop_channel.py). Metres and radians in here,
millimetres on the wire. The same driver drives the hardware and the simulated controller: whatever
answers at the configured host and ports.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator

from hw.arm import Arm, TcpBoundary
from hw.lite6.commands import NOT_CONNECTED, activity_of, arm_fault, checked_goal, servo_of
from hw.lite6.protocol import Mode
from hw.lite6.setup import STOP_TIMEOUT_S, Lite6Connection
from tams_app.config import ArmConfig
from tams_app.errors import DeviceError
from tams_app.records import ArmState, CommandLink, LinkFault, Twist
from tams_app.runtime.clock import Clock
from tams_app.units import NS_PER_S

_STOPPED_MEANWHILE = "The arm was stopped meanwhile; arm it again when that is wanted."


class Lite6(Arm):
    """One Lite 6.

    `send_*`, `set_gripper`, `stop`, `state` and `link` may be called from any thread; the others
    from one thread at a time. A single reply that does not come within `reply_timeout_s` counts as
    slow; a second one in a row, a refused command or a lost connection is `link().failure`, after
    which nothing moves until `enable`. A lost connection is made anew by `clear_errors`.
    """

    def __init__(
        self,
        config: ArmConfig,
        clock: Clock,
        control_rate_hz: float = 120.0,
        boundary: TcpBoundary | None = None,
    ) -> None:
        """`control_rate_hz`: a reply that takes longer than one control period counts as slow.

        `boundary`: set in the controller on connecting; None leaves the controller's as it is.
        """
        self._config, self._clock = config, clock
        self._boundary = boundary
        self._slow_after_ns = round(NS_PER_S / control_rate_hz)
        self._connection: Lite6Connection | None = None
        self._renewed: Lite6Connection | None = None  # until it may take the place of that one
        self._stop_lock = threading.Lock()
        self._stops = 0

    def connect(self) -> None:
        connection = self._connection
        if connection is not None and connection.broken:
            connection.close()
            connection = self._connection = None
        if connection is None:
            connection = self._connection = self._open()
        connection.configure()

    def enable(self) -> None:
        connection, stops = self._required(), self._stops
        connection.outbox.shut()
        with self._stopped_on_failure(stops):
            connection.make_ready(Mode.CARTESIAN_VELOCITY)
        with self._stop_lock:
            if self._stops == stops:
                connection.sender.open()
                return
        self.stop()  # the earlier one may have been undone by getting ready
        raise DeviceError(_STOPPED_MEANWHILE)

    def begin_move_to_joints(self, joints: list[float], speed: float) -> None:
        goal = checked_goal(joints, speed)
        connection, stops = self._required(), self._stops
        connection.outbox.shut()
        with self._stopped_on_failure(stops):
            connection.make_ready(Mode.POSITION)
            if self._stops == stops:
                connection.begin_move(goal, speed)
            if self._stops != stops:
                raise DeviceError(_STOPPED_MEANWHILE)

    def state(self) -> ArmState | None:
        connection = self._connection
        if connection is None:
            return None
        motion, status = connection.reports.motion, connection.reports.status
        if motion is None or status is None:
            return None
        return ArmState(
            received_ns=motion.received_ns,
            joints=motion.joints,
            tcp=motion.tcp,
            activity=activity_of(motion.state),
            servo=servo_of(motion.mode),
            fault=arm_fault(status.error_code, status.drive_codes),
            warning_code=status.warning_code,
            gripper_closed=connection.sender.gripper_closed,
            hottest_motor_c=max(status.temperatures_c),
        )

    def link(self) -> CommandLink:
        connection = self._connection
        if connection is None:
            return CommandLink(0, 0, 0, 0, NOT_CONNECTED, LinkFault.LOST)
        return connection.link

    def send_twist(self, twist: Twist) -> None:
        if self._connection is not None:
            self._connection.outbox.put_motion(twist)

    def set_gripper(self, closed: bool) -> None:
        if self._connection is not None:
            self._connection.outbox.put_gripper(closed)

    def stop(self) -> None:
        with self._stop_lock:
            self._stops += 1
            for connection in (self._connection, self._renewed):
                if connection is not None:
                    connection.outbox.shut()
                    connection.stop.request_stop()

    def clear_errors(self) -> None:
        """Clear the controller's error and the link's failure; DeviceError if it persists.

        Where only a new connection helps (the controller was restarted, say) it is made, and the
        arm is checked and configured as by `connect`. Until that is done `state` and `link` show
        the old one, and `stop` goes to both.
        """
        connection = self._required()
        if connection.broken:
            self._renew(connection)
        else:
            connection.clear_errors()

    def close(self) -> None:
        self.stop()
        with self._stop_lock:
            connection, self._connection = self._connection, None
        if connection is None:
            return
        connection.stop.wait_acknowledged(STOP_TIMEOUT_S)
        connection.close()
        if connection.stop.pending:
            raise DeviceError(
                "The arm did not acknowledge its last stop; "
                "press the emergency stop button unless it stands still."
            )

    @property
    def realtime_thread_ids(self) -> dict[str, int]:
        return {} if self._connection is None else self._connection.thread_ids

    def _open(self) -> Lite6Connection:
        return Lite6Connection(self._config, self._clock, self._slow_after_ns, self._boundary)

    def _renew(self, broken: Lite6Connection) -> None:
        """Replace a connection once the new one is configured; meanwhile a stop goes to both.

        If that fails the broken one stays, and the next `clear_errors` begins anew.
        """
        broken.disconnect()
        stops = self._stops
        renewed = self._open()
        with self._stop_lock:
            self._renewed = renewed
            if self._stops != stops:
                renewed.stop.request_stop()
        try:
            renewed.clear_errors()
            renewed.take_scheduling(broken)
            with self._stop_lock:
                if self._connection is not broken:
                    raise DeviceError(NOT_CONNECTED)  # closed meanwhile
                self._connection, self._renewed = renewed, None
        except BaseException:
            with self._stop_lock:
                self._renewed = None
            renewed.close()
            raise
        broken.close()

    def _required(self) -> Lite6Connection:
        if self._connection is None:
            raise DeviceError(NOT_CONNECTED)
        return self._connection

    @contextlib.contextmanager
    def _stopped_on_failure(self, stops: int) -> Iterator[None]:
        """Inside, the arm becomes ready to move: if anything fails there it is stopped again.

        After more stops than `stops` that is why it failed, however it showed.
        """
        try:
            yield
        except BaseException as error:
            stopped_meanwhile = self._stops != stops
            self.stop()
            if stopped_meanwhile and isinstance(error, DeviceError):
                raise DeviceError(_STOPPED_MEANWHILE) from error
            raise
