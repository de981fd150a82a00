"""One pick-and-place in virtual time: the same seed gives the same log, on any processor load.

    python -m examples.virtual_trial [SECONDS]

A simulated operator who sees only the received frames grasps the block over network s3. A whole
trial takes a minute or two; SECONDS (of virtual time) ends it earlier.
"""

import json
import sys
import time
from pathlib import Path

from tams_app.config import load_config
from tams_app.session.virtual.runner import run_virtual_trial

overrides = {"network": "s3", "strategy": "tams", "seed": 4}
if len(sys.argv) > 1:
    overrides["seconds"] = float(sys.argv[1])
config = load_config(overrides=overrides)

folder = Path(config.recording.directory) / "virtual-trial"
folder.mkdir(parents=True, exist_ok=True)
outcome = run_virtual_trial(config, participant_seed=7, folder=folder, wall_start_ns=time.time_ns())

summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
print(f"completed: {outcome.completed}, success: {outcome.success}, drops: {outcome.drops}")
for name, view in summary["views"].items():
    print(f"{name}: {view['sent_kbps_mean']:.0f} kbit/s, received SSIM {view['received_ssim']}")
print(f"Everything else is in {folder}")
