"""TAMS in the place of the phase and the allocation node that the paper's authors published.

    python -m benchmarks.experiments.authors_nodes [DOMAIN]

Takes from ROS 2 what theirs take, `/tams/end_effector_velocity`, `/tams/gripper_closed` and
`/tams/uplink_budget_mbps`, and gives what theirs give, `/tams/phase` and `/tams/bitrate_targets`,
by `preset: reference`: for an arm and encoders that TAMS does not drive. Ends with Ctrl-C.
"""

import json
import math
import sys
import time
from dataclasses import dataclass

from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import final
from cyclonedds.idl.types import float32
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from tams_app.config import load_config
from tams_app.policy.allocation import STRATEGIES
from tams_app.policy.phases import PhaseTracker
from tams_app.records import Phase
from tams_app.ros2.messages import AUTHORS, String, TwistStamped

PHASE_HZ, ALLOCATIONS_EVERY = 50.0, 5  # as theirs: 50 and 10 times a second
BUDGET_MBPS = 6.0  # until one is received
_CDR = Policy.DataRepresentation(use_cdrv0_representation=True)
QOS = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(1), _CDR)  # any writer's


@dataclass
@final
class Bool(IdlStruct, typename="std_msgs::msg::dds_::Bool_"):
    data: bool


@dataclass
@final
class Float32(IdlStruct, typename="std_msgs::msg::dds_::Float32_"):
    data: float32


class Nodes:
    """Both, as one object without a clock and without ROS."""

    def __init__(self) -> None:
        self.policy = load_config(overrides={"preset": "reference"}).policy
        self.tracker = PhaseTracker(self.policy.phases)
        self.tams = STRATEGIES["tams"](self.policy)
        self.velocity = (0.0, 0.0, 0.0)  # of the tool [m/s]
        self.closed = False
        self.budget_mbps = BUDGET_MBPS

    def infer(self, period_s: float) -> Phase:
        """The phase after the next period."""
        speed, vertical = math.hypot(*self.velocity), self.velocity[2]
        return self.tracker.step(
            speed=speed, vertical_speed=vertical, closed=self.closed, period_s=period_s
        ).phase

    def targets(self) -> str:
        """What `/tams/bitrate_targets` says."""
        phase = self.tracker.phase
        given = self.tams.targets(phase, 1000 * self.budget_mbps)
        views = {view.upper(): kbps / 1000 for view, kbps in given.items()}
        return json.dumps({"phase": phase.word, "targets_mbps": views})


def main(domain: int) -> None:
    participant = DomainParticipant(domain)

    def reader(name: str, kind: type[IdlStruct]) -> DataReader[IdlStruct]:
        return DataReader(participant, Topic(participant, f"rt/tams/{name}", kind), qos=QOS)

    velocities = reader("end_effector_velocity", TwistStamped)
    grippers, budgets = reader("gripper_closed", Bool), reader("uplink_budget_mbps", Float32)
    reliable = Qos(Policy.Reliability.Reliable(0), Policy.History.KeepLast(10), _CDR)
    phases, targets = (
        DataWriter(participant, Topic(participant, one.dds_name, one.type), qos=reliable)
        for one in AUTHORS
    )
    nodes, number, last_s = Nodes(), 0, time.monotonic()
    while True:
        time.sleep(1 / PHASE_HZ)
        for received in velocities.take():
            if isinstance(received, TwistStamped):  # else a writer has left
                linear = received.twist.linear
                nodes.velocity = (linear.x, linear.y, linear.z)
        for received in grippers.take():
            nodes.closed = received.data if isinstance(received, Bool) else nodes.closed
        for received in budgets.take():
            if isinstance(received, Float32) and 0 <= received.data < math.inf:
                nodes.budget_mbps = received.data
        now_s = time.monotonic()
        phases.write(String(nodes.infer(now_s - last_s).word))
        last_s = now_s
        if number % ALLOCATIONS_EVERY == 0:
            targets.write(String(nodes.targets()))
        number += 1


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 0)
