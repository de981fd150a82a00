"""The bench in virtual time: the in-process arm, exactly one motion command in every tick."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

import numpy as np

from hw.sim.controller.inprocess_arm import InProcessArm
from tams_app.config import load_config
from tams_app.records import ArmState, Vector
from tams_app.runtime.clock import VirtualClock
from tams_app.teleop.records import TeleopOutput
from tams_app.teleop.safety import Request as ArmRequest
from tams_app.units import NS_PER_S
from tests.faults.bench import ACROSS, PERIOD_NS, RATE_HZ, Bench, Pace
from tests.faults.frames import Sight
from tests.faults.wire import tapped_model


class VirtualBench(Bench):
    """Time passes as the test says, and nothing waits."""

    pace = Pace(cruise=ACROSS, cruise_s=0.45, rest_s=1.0, move_s=0.5, standing_ticks=30)

    def __init__(self, folder: Path | None = None, sight: Sight | None = None) -> None:
        config, clock, model = load_config(), VirtualClock(), tapped_model()
        self._virtual_clock = clock
        self._virtual_arm = InProcessArm(config.arm, clock, model)
        self._virtual_arm.connect()
        super().__init__(config, clock, self._virtual_arm, model, folder, sight)

    @property
    def lock(self) -> AbstractContextManager[object]:
        return nullcontext()

    def advance(self, duration_ns: int) -> None:
        """Let time pass for the arm without a tick."""
        self._virtual_clock.advance_ns(duration_ns)
        self._virtual_arm.state()

    def suspend_s(self, duration_s: int) -> None:
        """The computer sleeps for that long."""
        self._virtual_clock.suspend_ns(duration_s * NS_PER_S)

    # --- what was commanded ---------------------------------------------------------------------

    def commands(self, first: int, last: int | None = None) -> list[Vector | None]:
        """What each tick from `first` to before `last` (default: all) put on the wire.

        Linear [m/s] and angular [rad/s] velocity, shape (6,); None where no motion was sent.
        """
        found: dict[int, Vector] = {}
        for request in self.model.wire:
            if not request.is_motion:
                continue
            assert request.tick not in found, f"two motion commands in tick {request.tick}"
            found[request.tick] = request.velocity
        return [found.get(tick) for tick in range(first, last or self.next)]

    def velocities(self, first: int, last: int | None = None) -> Vector:
        """As `commands`, where every tick sent a motion: shape (ticks, 6)."""
        sent = self.commands(first, last)
        assert all(velocity is not None for velocity in sent), "a tick without a motion command"
        return np.array(sent)

    # --- how time passes ------------------------------------------------------------------------

    def _let_pass(self, duration_ns: int) -> None:
        self.advance(duration_ns)

    def _settle(self, output: TeleopOutput) -> None:
        """Everything reaches the model at once."""

    def quiesce(self) -> None:
        """Every reply is there at once."""

    def until_seen(self, sign: Callable[[ArmState], bool]) -> None:
        for _ in range(RATE_HZ):
            state = self.arm.state()
            if state is not None and sign(state):
                return
            self.advance(PERIOD_NS // 4)
        raise AssertionError("the arm does not report it")

    def request(self, request: ArmRequest) -> None:
        self.gate.request(request)
        self.gate.serve()
