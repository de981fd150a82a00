"""A rig in virtual time, driven by the scripted operator with perfect eyes."""

from __future__ import annotations

import numpy as np

from hw.boundary import session_boundary
from hw.sim.controller.inprocess_arm import InProcessArm
from hw.sim.controller.model import ControllerModel
from hw.sim.layout import draw_layout
from hw.sim.operator.demo import demo_controller
from hw.sim.world.world import World
from tams_app.config import Config
from tams_app.records import Outcome, ServoMode
from tams_app.runtime.clock import VirtualClock
from tams_app.session import build
from tams_app.session.arm_gate import ArmGate
from tams_app.session.control import ControlLoop, Signals, SteadyVideo
from tams_app.study.trial import TrialJudge
from tams_app.units import NS_PER_S


def _ignore(*_: object) -> None:
    """Nobody records this rig."""


def drive(config: Config, longest_s: float) -> Outcome:
    """One trial with the product's own control loop, from confirming to the verdict."""
    clock = VirtualClock()
    joints = np.radians(np.array(config.arm.ready_joints_deg))
    world = World(draw_layout(config.seed), joints)
    boundary = session_boundary(config.arm, config.limits)
    arm = InProcessArm(config.arm, clock, ControllerModel(world, joints), boundary)
    gate = ArmGate(arm, ServoMode(config.arm.servo), boundary, _ignore)
    controller = demo_controller(config, lambda: world.truth(clock.now_ns()))
    judge = TrialJudge(config.trial, build.task_geometry())
    loop = ControlLoop(config, clock, controller, arm, gate, SteadyVideo(), Signals())
    arm.connect()
    controller.start()
    end_ns = clock.now_ns() + round(longest_s * NS_PER_S)
    ended = False
    while not ended and clock.now_ns() < end_ns:
        clock.advance_ns(round(NS_PER_S / config.control.rate_hz))
        output = loop.tick(clock.now_ns())
        gate.serve()
        if output.deadman and output.arming.value == "engaged":
            judge.engaged(clock.now_ns())
        state = arm.state()
        closed = state.gripper_closed if state is not None else None
        ended = judge.step(clock.now_ns(), world.truth(clock.now_ns()), closed)
    return judge.outcome()
