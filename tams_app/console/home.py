"""`home` as a person meets it: the arm's way to its ready pose, while Enter is held."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

from rich.console import Console

from hw.arm import Arm
from hw.boundary import reach_boundary
from hw.guard_link import GuardLink, guard_specification
from hw.lite6 import Lite6
from tams_app.clock import MonotonicClock
from tams_app.config import Config
from tams_app.console.terminal import TerminalKeys
from tams_app.errors import ConfigError, DeviceError, SetupError
from tams_app.process import HelperProcess
from tams_app.records import LinkFault
from tams_app.session.guarding import SILENCE_NS
from tams_app.session.home import HomeRun
from tams_app.session.homing import HomingState

_CONSENT_POLL_S = 0.2


def run_home(config: Config, terminal_fd: int = 0, console: Console | None = None) -> int:
    """Move the arm to its ready pose; 0 if it is there, 1 if the operator ended it before.

    Where a step fails it raises a TamsError, with the arm stopped.
    """
    if config.rig.enabled:
        raise ConfigError("home moves a real arm: give --config with a file of your hardware")
    console = console or Console()
    clock = MonotonicClock()

    def say(text: str) -> None:
        console.print(text, highlight=False, markup=False, soft_wrap=True)

    with ExitStack() as stack:
        keys = TerminalKeys(terminal_fd)
        stack.callback(keys.close)
        keys.open()
        if not keys.active:
            raise SetupError("home needs a terminal of its own: the arm moves while Enter is held")
        process = HelperProcess("guard", "hw.guard", guard_specification(config.arm), None)
        stack.callback(process.stop)
        boundary = reach_boundary(config.arm, config.limits)
        arm = Lite6(config.arm, clock, config.control.rate_hz, boundary)
        stack.callback(arm.close)
        say(f"Connecting to the arm at {config.arm.host} ...")
        connect_with_consent(arm, keys.read_bytes, say)
        process.start()
        guard = GuardLink(int(process.wait_ready()["port"]), SILENCE_NS)
        stack.callback(guard.close)
        # what was pushed last is undone first: the arm must stand before the guard lets go
        stack.callback(arm.close)
        executor = stack.enter_context(ThreadPoolExecutor(1, thread_name_prefix="arm-homing"))
        run = HomeRun(config, clock, arm, guard, executor, keys.read_bytes, say)
        return 0 if run.run() is HomingState.DONE else 1


def connect_with_consent(
    arm: Arm, read_keys: Callable[[float], bytes], say: Callable[[str], None]
) -> None:
    """Connect; an error of the arm's controller is cleared if the operator presses Enter."""
    try:
        arm.connect()
    except DeviceError as error:
        if arm.link().fault is LinkFault.LOST:
            raise
        say(f"{error}\nEnter clears the error, any other key ends.")
        answer = b""
        while not answer:
            answer = read_keys(_CONSENT_POLL_S)
        if answer[:1] not in (b"\r", b"\n"):
            raise
        arm.clear_errors()
        arm.connect()
