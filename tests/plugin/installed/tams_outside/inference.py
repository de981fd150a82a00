"""An inference that takes everything for Transport."""

from tams_app.config import PhasesConfig
from tams_app.records import ArmState, Phase, PhaseChange


class Always:
    speed = vertical_speed = 0.0

    def __init__(self, config: PhasesConfig) -> None:
        self.phase = Phase.REACH

    def step(self, now_ns: int, arm: ArmState | None) -> PhaseChange | None:
        if self.phase is Phase.TRANSPORT:
            return None
        self.phase = Phase.TRANSPORT
        return PhaseChange(now_ns, self.phase, "outside")
