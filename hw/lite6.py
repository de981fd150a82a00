"""The UFACTORY Lite 6 behind the arm interface, through UFACTORY's SDK.

Threads: `arm-sender` (commands, hw/lite6_sender.py), the SDK's receiver of replies, `arm-report`
(states, hw/lite6_report.py) and `arm-stop` (hw/stop_channel.py). Metres and radians in here,
millimetres on the wire. What the driver drives, hardware or the simulated controller, it does not
know: it is whatever answers at the configured host and ports.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator

import numpy as np

from hw.arm import Arm, ServoMode
from hw.lite6_codes import Code, Mode, State
from hw.lite6_kinematics import within_joint_limits
from hw.lite6_setup import STOP_TIMEOUT_S, Lite6Connection, accept
from tams_app.clock import NS_PER_S, Clock
from tams_app.config import LITE6_MAX_JOINT_SPEED_RAD_S, ArmConfig
from tams_app.errors import DeviceError
from tams_app.records import ArmState, CommandLink, Pose, Twist, Vector

READY_ACCELERATION_RAD_S2 = 1.0
ARRIVED_RAD = 0.005
ERROR_GONE_TIMEOUT_S = 1.0  # five periods of the report that tells

_MODES = {ServoMode.VELOCITY: Mode.CARTESIAN_VELOCITY, ServoMode.POSE: Mode.SERVO}
_STOPPED_MEANWHILE = "The arm was stopped meanwhile; arm it again when that is wanted."


class Lite6(Arm):
    """One Lite 6.

    `send_*`, `set_gripper`, `stop`, `state` and `link` may be called from any thread; the others
    from one thread at a time. A single reply that does not come within `reply_timeout_s` counts as
    slow; a second one in a row, a refused command or a lost connection is `link().failure`, after
    which nothing moves until `enable`. After a lost connection: `close`, then `connect`.
    """

    def __init__(self, config: ArmConfig, clock: Clock, control_rate_hz: float = 120.0) -> None:
        """`control_rate_hz`: a reply that takes longer than one control period counts as slow."""
        self._config, self._clock = config, clock
        self._slow_after_ns = round(NS_PER_S / control_rate_hz)
        self._connection: Lite6Connection | None = None
        self._stop_lock = threading.Lock()
        self._stops = 0

    def connect(self) -> None:
        """Connect, stop the arm, check and configure it; DeviceError says what is wrong.

        An error of the controller (an emergency stop, say) is also a DeviceError, but the
        connection stays, for `clear_errors` and another `connect`.
        """
        if self._connection is None:
            self._connection = Lite6Connection(self._config, self._clock, self._slow_after_ns)
        self._connection.configure()

    def enable(self, servo: ServoMode) -> None:
        connection, stops = self._required(), self._stops
        connection.outbox.shut()
        with self._stopped_on_failure():
            connection.make_ready(_MODES[servo])
        motion = connection.reports.motion
        with self._stop_lock:
            if motion is not None and self._stops == stops:
                connection.sender.open(servo, motion.tcp)
                return
        self.stop()  # the earlier one may have been undone by getting ready
        raise DeviceError(_STOPPED_MEANWHILE)

    def move_to_joints(self, joints: list[float], speed: float, timeout_s: float) -> None:
        """Move to `joints` [rad] at `speed` [rad/s] and wait; no servo is enabled afterwards."""
        goal = np.array(joints, dtype=np.float64)
        if goal.shape != (6,) or not np.isfinite(goal).all() or not within_joint_limits(goal):
            raise DeviceError("The joint angles to move to are outside the Lite 6's limits.")
        if not 0 < speed <= LITE6_MAX_JOINT_SPEED_RAD_S:
            raise DeviceError(f"A joint speed of {speed:g} rad/s is outside the Lite 6's limits.")
        connection, stops = self._required(), self._stops
        connection.outbox.shut()
        with self._stopped_on_failure():
            connection.make_ready(Mode.POSITION)
            with connection.patiently():
                code = connection.api.set_servo_angle(
                    angle=goal.tolist(),
                    speed=speed,
                    mvacc=READY_ACCELERATION_RAD_S2,
                    is_radian=True,
                    wait=False,  # the SDK's own waiting cannot be interrupted
                )
            if self._stops == stops:
                accept(code, "the move")
        self._await_arrival(connection, goal, stops, timeout_s)

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
            mode=motion.mode,
            state=motion.state,
            error_code=status.error_code,
            warning_code=status.warning_code,
            gripper_closed=connection.sender.gripper_closed,
        )

    def link(self) -> CommandLink:
        connection = self._connection
        if connection is None:
            return CommandLink(0, 0, 0, 0, "The arm is not connected; connect it first.")
        return connection.link

    def send_twist(self, twist: Twist) -> None:
        if self._connection is not None:
            self._connection.outbox.put_motion(twist)

    def send_pose(self, pose: Pose) -> None:
        if self._connection is not None:
            self._connection.outbox.put_motion(pose)

    def set_gripper(self, closed: bool) -> None:
        if self._connection is not None:
            self._connection.outbox.put_gripper(closed)

    def stop(self) -> None:
        with self._stop_lock:
            self._stops += 1
            connection = self._connection
            if connection is not None:
                connection.outbox.shut()
                connection.stop.request_stop()

    def clear_errors(self) -> None:
        """Clear the controller's error and the link's failure; DeviceError if it persists."""
        connection = self._required()
        connection.outbox.shut()
        with connection.patiently():
            # the reply to these still tells of the error: whether it went is seen in the reports
            accept(connection.api.clean_error(), "clearing the error", but=Code.ERROR)
            accept(connection.api.clean_warn(), "clearing the warning", but=Code.ERROR)
            accept(connection.api.set_state(State.STOPPED), "a stop")
        asked_ns = self._clock.now_ns()
        reports = connection.reports

        def is_clear() -> bool:
            status = reports.status
            return status is not None and status.received_ns > asked_ns and not status.error_code

        if not reports.wait_for(is_clear, ERROR_GONE_TIMEOUT_S):
            connection.raise_error()
            raise DeviceError(
                reports.failure or "The arm sends no reports; close the connection and connect."
            )
        connection.sender.forget_failure()

    def close(self) -> None:
        """Stop the arm and hang up; DeviceError, with all closed, if it acknowledged no stop."""
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
        """Kernel ids of the threads between the control loop and the arm, by name.

        For real-time scheduling: without the SDK's receiver (`arm-replies`) a command's way back
        is as slow as without any.
        """
        connection = self._connection
        if connection is None:
            return {}
        ids = {
            **connection.sender.thread_ids,
            "arm-report": connection.reports.native_id,
            "arm-stop": connection.stop.native_id,
        }
        return {name: native_id for name, native_id in ids.items() if native_id is not None}

    def _required(self) -> Lite6Connection:
        if self._connection is None:
            raise DeviceError("The arm is not connected; connect it first.")
        return self._connection

    @contextlib.contextmanager
    def _stopped_on_failure(self) -> Iterator[None]:
        """Inside, the arm becomes ready to move: if anything fails there it is stopped again."""
        try:
            yield
        except BaseException:
            self.stop()
            raise

    def _await_arrival(
        self, connection: Lite6Connection, goal: Vector, stops: int, timeout_s: float
    ) -> None:
        reports = connection.reports
        started_ns = self._clock.now_ns()

        def arrived() -> bool:
            motion = reports.motion
            return (
                motion is not None
                and motion.received_ns > started_ns
                and motion.state == State.STANDBY
                and float(np.abs(motion.joints - goal).max()) < ARRIVED_RAD
            )

        def ended() -> bool:
            motion = reports.motion
            stopped = motion is not None and motion.state >= State.STOPPED
            return self._stops != stops or stopped or arrived()

        reports.wait_for(ended, timeout_s)
        if self._stops == stops and arrived():
            return
        stopped_meanwhile = self._stops != stops
        self.stop()
        if stopped_meanwhile:
            raise DeviceError(_STOPPED_MEANWHILE)
        connection.raise_error()
        raise DeviceError(
            connection.failure
            or f"The arm did not get where it was sent within {timeout_s:g} s; "
            "look for what holds it and try again."
        )
