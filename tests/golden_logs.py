"""The sessions whose recomputation must stay as it is, and how their logs are made anew.

`python -m tests.golden_logs FOLDER` runs both in virtual time and writes FOLDER/NAME.mcap. What a
recomputation does not read is left out. Make them anew only where a change of what the arm is told
is meant, and say so with the change.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

from tams_app.recording import LOG_NAME, Facts, SessionLog, read_log
from tams_app.recording.mcap_log import McapLog
from tests.session.virtual.runs import run, short

DATA = Path(__file__).parent / "data"
GOLDEN: dict[str, dict[str, Any]] = {
    # from reach to transport, the capacity estimated from what receivers tell
    "feedback": {"network": "s2", "seconds": 15.0},
    # the capacity known, and an outage in mid-motion
    "outage": {
        "network": "config/traces/outage.csv",
        "seconds": 14.0,
        "strategy": "equal",
        "policy.budget.mode": "oracle",
    },
}


def golden_log(name: str) -> Path:
    """Where the log of that name is kept."""
    return DATA / f"golden-{name}.mcap"


def write_thinned(log: SessionLog, path: Path) -> None:
    """Only what was told to control and policy, and what they made of it."""
    thinned = McapLog(path, log.header)
    records = [*log.ticks, *log.phases, *log.allocations, *log.policy_inputs]
    thinned.write(Facts(log.header.started_ns, log.facts), 0)
    for record in records:
        thinned.write(record, 0)
    thinned.close()


def main() -> None:
    for name, changes in GOLDEN.items():
        with tempfile.TemporaryDirectory() as folder:
            run(short(**changes), Path(folder))
            log = read_log(Path(folder) / LOG_NAME)
        write_thinned(log, Path(sys.argv[1]) / f"golden-{name}.mcap")


if __name__ == "__main__":
    main()
