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

from foxglove import Context, Schema, open_mcap
from foxglove.mcap import MCAPWriteOptions
from mcap.reader import make_reader

from tams_app.recording import LOG_NAME, Facts, SessionLog, read_log
from tams_app.recording.topics import PROFILE
from tests.session.virtual.runs import run, short
from tests.synthetic_session import write_log

DATA = Path(__file__).parent / "data"
GOLDEN: dict[str, dict[str, Any]] = {
    # the capacity estimated from what receivers tell
    "feedback": {"network": "s2", "seconds": 4.3},
    # from reach to transport, the capacity known, and an outage in mid-motion
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
    facts = Facts(log.header.started_ns, log.facts)
    records = [facts, *log.ticks, *log.phases, *log.allocations, *log.policy_inputs]
    write_log(path, records, log.header)


def pack(path: Path) -> None:
    """Write the log again, compressed as far as it goes."""
    with path.open("rb") as file:
        messages = list(make_reader(file).iter_messages(log_time_order=False))
    path.unlink()
    context, channels = Context(), {}
    options = MCAPWriteOptions(profile=PROFILE, compression_level=19)
    with open_mcap(path, context=context, writer_options=options):
        for schema, channel, message in messages:
            if channel.id not in channels:
                made = Schema(name=schema.name, encoding=schema.encoding, data=schema.data)
                channels[channel.id] = context._create_channel(
                    channel.topic, message_encoding=channel.message_encoding, schema=made
                )
            channels[channel.id].log(message.data, message.log_time)


def main() -> None:
    for name, changes in GOLDEN.items():
        with tempfile.TemporaryDirectory() as folder:
            run(short(**changes), Path(folder))
            log = read_log(Path(folder) / LOG_NAME)
        write_thinned(log, path := Path(sys.argv[1]) / f"golden-{name}.mcap")
        pack(path)


if __name__ == "__main__":
    main()
