"""Drive the simulated arm through `hw.arm.Arm`, the interface that real arms implement too."""

import numpy as np

from hw.sim.controller.inprocess_arm import InProcessArm
from tams_app.config import load_config
from tams_app.records import Twist
from tams_app.runtime.clock import VirtualClock
from tams_app.units import NS_PER_MS

config = load_config()  # config/tams.yaml
clock = VirtualClock()  # time passes only when we say so
arm = InProcessArm(config.arm, clock)  # the controller's model in this process, without a network


def show(what: str) -> None:
    state = arm.state()  # the newest report, None before the first
    assert state is not None
    print(f"{what:<22} TCP at {np.round(1000 * state.tcp.position, 1)} mm")


arm.connect()
clock.advance_ns(100 * NS_PER_MS)
show("factory home")

arm.begin_move_to_joints(list(np.radians(config.arm.ready_joints_deg)), speed=0.5)  # [rad/s]
clock.advance_ns(5_000 * NS_PER_MS)
show("ready pose")

arm.enable()
upwards = Twist(linear=(0.0, 0.0, 0.05), angular=(0.0, 0.0, 0.0))  # [m/s], [rad/s]
for _ in range(120):  # one second at 120 Hz: a velocity counts for `arm.duration_s` only
    arm.send_twist(upwards)
    clock.advance_ns(1000 * NS_PER_MS // 120)
show("about 5 cm higher")

arm.stop()
arm.close()
