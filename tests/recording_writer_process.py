"""Records a session for ever, to be killed by a test; the argument is the log's path.

Two episodes end within its first 40 ticks, the third one never does. Prints the number of ticks
handed over so far, every 100 ms.
"""

from __future__ import annotations

import itertools
import sys
import time
from pathlib import Path

from tams_app.recording import Recorder
from tams_app.recording.journal import Journal
from tams_app.records import EpisodeRequest
from tams_app.robot.control import Signals
from tams_app.robot.episode_keeper import EpisodeKeeper
from tams_app.runtime.clock import MonotonicClock
from tams_app.task.episodes import Episodes
from tests.synthetic_session import header, tick

BEGIN_OR_END = (0, 20, 25, 39, 45)


def fail(thread: str, failure: BaseException) -> None:
    sys.exit(f"{thread}: {failure}")


def main() -> None:
    clock, signals = MonotonicClock(), Signals()
    recorder = Recorder(Path(sys.argv[1]), header(), clock, 0, fail)
    episodes = EpisodeKeeper(
        Episodes(0.0), signals, Journal(clock, recorder), lambda: None, lambda _reason: None
    )
    recorder.start()
    for number in itertools.count():
        if number in BEGIN_OR_END:
            signals.episode(EpisodeRequest.NEXT)
        recorder.record(tick(number))
        episodes.on_tick(tick(number))
        if number % 12 == 11:
            time.sleep(0.1)
            sys.stdout.write(f"{number + 1}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
