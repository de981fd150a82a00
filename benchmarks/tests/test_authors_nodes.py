"""The example that takes the place of the authors' nodes, over DDS in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.topic import Topic as DdsTopic

from benchmarks.experiments.authors_nodes import Bool, Float32
from tams_app.ros2.messages import AUTHORS, HeaderMsg, Time, TwistMsg, TwistStamped, Vector3
from tests.ros2.dds import RELIABLE, Node, free_domain, until

pytestmark = pytest.mark.waiting

ROOT = Path(__file__).parents[2]


@pytest.fixture
def domain() -> Iterator[int]:
    found = free_domain()
    command = [sys.executable, "-m", "benchmarks.experiments.authors_nodes", str(found)]
    with subprocess.Popen(command, cwd=ROOT) as nodes:
        yield found
        nodes.terminate()


def test_it_takes_their_topics_and_gives_theirs_in_their_words(domain: int) -> None:
    node, participant = Node(domain), DomainParticipant(domain)
    qos = Qos(RELIABLE, Policy.DataRepresentation(use_cdrv0_representation=True))

    def writer(name: str, kind: Any) -> DataWriter[Any]:
        return DataWriter(participant, DdsTopic(participant, f"rt/tams/{name}", kind), qos=qos)

    velocity = writer("end_effector_velocity", TwistStamped)
    gripper, budget = writer("gripper_closed", Bool), writer("uplink_budget_mbps", Float32)
    phase, targets = (node.reader(topic) for topic in AUTHORS)
    down = TwistMsg(Vector3(0.0, 0.0, -0.05), Vector3(0.0, 0.0, 0.0))

    def becomes(word: str, closed: bool, moving: bool) -> None:
        heard: list[str] = []

        def tell() -> None:
            still = TwistMsg(Vector3(0.0, 0.0, 0.0), Vector3(0.0, 0.0, 0.0))
            head = HeaderMsg(Time(0, 0), "base_link")
            velocity.write(TwistStamped(head, down if moving else still))
            gripper.write(Bool(closed))
            budget.write(Float32(0.6))

        def is_heard() -> bool:
            heard.extend(one.data for one in phase.take(100))
            return heard[-1:] == [word]

        until(is_heard, meanwhile=tell)

    becomes("Reach", closed=False, moving=False)
    becomes("Align", closed=False, moving=True)
    becomes("Grasp", closed=True, moving=False)
    becomes("Pre-release", closed=True, moving=True)
    found: list[dict[str, Any]] = []

    def is_given() -> bool:
        found.extend(json.loads(one.data) for one in targets.take(100))
        return bool(found) and found[-1]["phase"] == "Pre-release"

    until(is_given)
    assert found[-1]["targets_mbps"] == {"EIH": 0.2, "GT": 0.2, "GS": 0.2}  # below three floors
