"""The outbox between the control loop and the sender."""

from __future__ import annotations

import numpy as np
import pytest

from hw.lite6.sender import GRIPPER_QUEUE, Outbox
from tams_app.records import Twist

pytestmark = pytest.mark.waiting


def twist(speed: float) -> Twist:
    return Twist(np.array([speed, 0.0, 0.0]), np.zeros(3))


@pytest.fixture
def outbox() -> Outbox:
    made = Outbox()
    made.open()
    return made


def test_a_shut_outbox_takes_nothing() -> None:
    outbox = Outbox()
    outbox.put_motion(twist(0.1))
    outbox.put_gripper(True)
    outbox.open()
    work = outbox.take(0.0)
    assert work.motion is None
    assert work.gripper_closed is None


def test_only_the_newest_motion_is_sent_and_only_once(outbox: Outbox) -> None:
    newest = twist(0.2)
    outbox.put_motion(twist(0.1))
    outbox.put_motion(newest)
    assert outbox.take(0.0).motion is newest
    assert outbox.take(0.0).motion is None


def test_gripper_commands_keep_their_order_and_the_oldest_gives_way(outbox: Outbox) -> None:
    commands = [True, False, False, True, False]
    for closed in commands:
        outbox.put_gripper(closed)
    taken = [outbox.take(0.0).gripper_closed for _ in range(GRIPPER_QUEUE)]
    assert taken == commands[-GRIPPER_QUEUE:]
    assert outbox.take(0.0).gripper_closed is None


def test_shutting_forgets_what_waits_and_makes_taken_work_old(outbox: Outbox) -> None:
    outbox.put_motion(twist(0.1))
    opening = outbox.take(0.0).opening
    assert outbox.is_current(opening)
    outbox.put_motion(twist(0.1))
    outbox.put_gripper(True)
    outbox.shut()
    assert not outbox.is_open
    outbox.open()
    work = outbox.take(0.0)
    assert (work.motion, work.gripper_closed) == (None, None)
    assert not outbox.is_current(opening)
