"""A helper process for tests/runtime/test_process.py: does what its specification says."""

import os
import signal

from tams_app.runtime.process import HelperSide

LOADED_UNDER = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK


def main() -> None:
    side = HelperSide()
    behaviour = side.specification["behaviour"]
    if behaviour == "fail":
        side.fail("port 7 is in use: choose another one")
        return
    if behaviour == "die":
        os._exit(3)
    if behaviour == "stubborn":
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    if behaviour == "tell policy":
        side.ready(policy=LOADED_UNDER)
    else:
        side.ready(number=side.specification["number"])
    if behaviour == "listen":
        while not side.received and not side.stop_requested.wait(0.005):
            pass
        side.ready(**side.received)
    if behaviour == "listen for the last":
        while not side.received.get("last") and not side.stop_requested.wait(0.005):
            pass
        side.ready(**side.received)
    side.stop_requested.wait()
    if behaviour == "stubborn":
        signal.pause()


if __name__ == "__main__":
    main()
