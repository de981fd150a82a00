"""Run a session on the simulated rig: open it, poll it while it lasts, and read its state.

    python -m examples.live_session [SECONDS]

A simulated operator, who sees the received frames only, arms the arm and moves the block.
"""

import sys

from tams_app.config import load_config
from tams_app.robot.control import Signals
from tams_app.runtime.clock import MonotonicClock
from tams_app.session.folder import create_session_folder
from tams_app.session.run import run
from tams_app.session.session import Outset

seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 30.0
config = load_config(overrides={"headless": True, "seconds": seconds})  # of config/tams.yaml
outset = Outset(config, MonotonicClock(), create_session_folder(config), Signals())
with run(outset) as session:  # all is started; its end stops the arm first
    while not session.ended.wait(0.5):
        session.poll()  # ends it when its time is over, or a part of it has failed
        state = session.state()
        where = ", ".join(f"{mm:.0f}" for mm in state.tcp_mm or ())
        print(f"{state.t_s:5.1f} s  {state.arming:<9} {state.phase:<11} TCP ({where}) mm")
print(f"{outset.failure or outset.end_reason}; its log is in {outset.folder}")
