"""The Lite 6 controller box as a pure model: a request in, a reply out, one cycle at a time.

It holds no thread, socket or clock. `ControllerServer` puts it on TCP, `InProcessArm` drives it
in virtual time.
"""

from __future__ import annotations

from hw.arm import PlantState
from hw.lite6.codes import Register, ReplyBit
from hw.sim.controller.core import ControllerCore
from hw.sim.controller.joint_servo import CYCLE_NS, CommandError, MotionError
from hw.sim.controller.registers import serve_register
from hw.sim.controller.reports import ReportKind, pack_report
from tams_app.vectors import Joints

__all__ = ["CYCLE_NS", "ControllerModel", "IdealPlant", "ReportKind"]


class IdealPlant:
    """Joints that are where they should be, at once."""

    def step(self, joints_target: Joints, closing: bool | None, duration_ns: int) -> PlantState:
        return PlantState(joints_target, collision=False)


class ControllerModel(ControllerCore):
    """The box with its registers and reports; not safe for threads: its server holds a lock."""

    def handle(self, register: int, payload: bytes, now_ns: int) -> bytes:
        """Serve one request; the reply's status byte and data.

        A register the model does not have, or a payload it cannot read, changes nothing and sets
        the status bit INVALID.
        """
        self._now_ns = now_ns
        before = self._status()
        try:
            data = serve_register(self, register, payload)
        except CommandError:
            return bytes([before | ReplyBit.INVALID])
        except MotionError as fault:
            self.raise_error(fault.code)
            data = b""
        # a load is taken while ready and only then waits for `set_state(0)`: its reply says ready
        status = before if register == Register.SET_LOAD else self._status()
        return bytes([status]) + data

    def report(self, kind: ReportKind) -> bytes:
        """A whole report frame of `kind`, its length first."""
        return pack_report(kind, self)

    def _status(self) -> int:
        return (
            (0 if self.ready else ReplyBit.NOT_READY)
            | (ReplyBit.WARNING if self.warning_code else 0)
            | (ReplyBit.ERROR if self.error_code else 0)
        )
