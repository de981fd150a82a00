"""The control loop with the real teleoperation and the in-process arm, under a virtual clock."""

import numpy as np
import pytest

from hw.arm import ServoMode
from hw.sim.controller_model import ControllerModel
from hw.sim.inprocess_arm import InProcessArm
from hw.sim.operator import Operator
from hw.sim.perception import TruePerception
from hw.sim.plant import IdealPlant
from hw.sim.virtual_controller import SensorFault, VirtualController
from tams_app.clock import VirtualClock
from tams_app.config import load_config
from tams_app.records import Phase, Pose, SceneTruth
from tams_app.session import build
from tams_app.session.control import ControlHooks, ControlLoop
from tams_app.session.signals import Signals
from tams_app.teleop.safety import Request
from tams_app.video.repair import RepairRule
from tests.hw.sim.toy_robot import ToyScene

PERIOD_NS = 1_000_000_000 // 120
