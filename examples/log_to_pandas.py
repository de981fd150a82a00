"""Read a session's log into pandas: every control tick and every frame that was shown.

python -m examples.log_to_pandas logs/20260101-120000-run
"""

import sys
from pathlib import Path

import pandas as pd

from tams_app.recording import read_log

log = read_log(Path(sys.argv[1]) / "session.mcap")
start_ns = log.header.started_ns

ticks = pd.DataFrame(
    {
        "t_s": (tick.started_ns - start_ns) / 1e9,
        "state": tick.arming,
        "phase": tick.phase.name,
        "speed_mm_s": 1000 * tick.speed,
        "cost_ms": (tick.finished_ns - tick.started_ns) / 1e6,
    }
    for tick in log.ticks
)
print(ticks.groupby("phase", sort=False)[["speed_mm_s", "cost_ms"]].mean().round(2))

captured, shown = pd.DataFrame(log.captured), pd.DataFrame(log.shown)  # one column per field
frames = captured.merge(shown, on=["view", "index"])  # a frame's identity is its view and index
frames["latency_ms"] = (frames["shown_ns"] - frames["capture_ns"]) / 1e6
print(frames.groupby("view")["latency_ms"].describe().round(1))
