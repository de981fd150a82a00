"""An inference that takes everything for Transport."""

from tams_app.policy.inference import Inference
from tams_app.records import ArmState, Phase, PhaseChange


class Always(Inference):
    def step(self, now_ns: int, arm: ArmState | None) -> PhaseChange | None:
        if self.phase is Phase.TRANSPORT:
            return None
        self.phase = Phase.TRANSPORT
        return PhaseChange(now_ns, self.phase, "outside")
