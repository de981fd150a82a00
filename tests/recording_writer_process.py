"""Records a session for ever, to be killed by a test; the argument is the log's path.

Prints the number of ticks handed over so far, every 100 ms.
"""

from __future__ import annotations

import itertools
import sys
import time
from pathlib import Path

from tams_app.recording import Recorder
from tams_app.runtime.clock import MonotonicClock
from tests.synthetic_session import header, tick


def fail(thread: str, failure: BaseException) -> None:
    sys.exit(f"{thread}: {failure}")


def main() -> None:
    recorder = Recorder(Path(sys.argv[1]), header(), MonotonicClock(), 0, fail)
    recorder.start()
    for number in itertools.count():
        recorder.record(tick(number))
        if number % 12 == 11:
            time.sleep(0.1)
            sys.stdout.write(f"{number + 1}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
