"""The trial of a session on the simulated rig, whose scene is known: it is judged while it runs."""

from __future__ import annotations

from hw.sim.layout import BLOCK_HEIGHT_M, CONTAINER_HEIGHT_M, CONTAINER_INNER_M
from tams_app.config import TrialConfig
from tams_app.records import ArmState, Outcome, Record, SceneTruth, Tick
from tams_app.robot.listener import Listener
from tams_app.robot.observers import TrialLook
from tams_app.task.judge import TaskGeometry, TrialJudge
from tams_app.teleop.safety import ArmingState


class TrialObserver(Listener):
    """Asks the judge of a pick-and-place at each look, some `TRIAL_RATE_HZ` a second."""

    def __init__(self, config: TrialConfig) -> None:
        self._config = config
        self._judge = self._new_judge()
        self._first_placed: TrialJudge | None = None

    @property
    def started(self) -> bool:
        """The operator has engaged the arm."""
        return self._judge.started

    def receive(self, record: Record) -> None:
        if isinstance(record, Tick) and record.arming == ArmingState.ENGAGED.value:
            self._judge.engaged(record.started_ns)

    def again(self) -> None:
        """Judge anew, as the block is put back; the first trial that was placed stays the verdict.

        In the control thread.
        """
        self._first_placed = self._first_placed or (self._judge if self._judge.placed else None)
        self._judge = self._new_judge()

    def look(
        self, now_ns: int, scene: SceneTruth, arm: ArmState | None, is_limited: bool
    ) -> TrialLook:
        """Ask the judge; `is_limited`: it ends when the block is placed or its time is over.

        A person takes their time and goes on for as long as they like.
        """
        closed = None if arm is None else arm.gripper_closed
        judge = self._judge
        was_placed = judge.placed
        if not judge.step(now_ns, scene, closed, is_limited):
            return TrialLook()
        return TrialLook(judge.placed and not was_placed, is_limited)

    def outcome(self, reason: str) -> Outcome:
        """The verdict; `reason` says why the session ended."""
        return (self._first_placed or self._judge).outcome(reason)

    def _new_judge(self) -> TrialJudge:
        return TrialJudge(self._config, task_geometry())


def task_geometry() -> TaskGeometry:
    """Sizes of the simulated rig's things, for the rules of the trial."""
    return TaskGeometry(
        container_inner=CONTAINER_INNER_M,
        container_height=CONTAINER_HEIGHT_M,
        block_rest_height=BLOCK_HEIGHT_M / 2,
    )
