"""A virtual trial with all that it leaves: its log, its configuration, its summary."""

from __future__ import annotations

from pathlib import Path

import cv2

from tams_app.config import Config
from tams_app.recording import LOG_NAME, read_log
from tams_app.records import Outcome
from tams_app.runtime.realtime import keep_freed_memory
from tams_app.session.folder import furnish_session_folder
from tams_app.session.virtual.trial import VirtualTrial
from tams_app.summary.summarise import save_summary, summarise


def run_virtual_trial(
    config: Config, participant_seed: int, folder: Path, wall_start_ns: int
) -> Outcome:
    """Run one trial to its end; session.mcap, config.yaml and summary.json are in `folder` then.

    In the main thread of a process that does nothing else (`tams_app.video.virtual`).
    `wall_start_ns`: when it began by the wall's clock, for the log's header. The same arguments
    leave the same bytes on the same machine.
    """
    keep_freed_memory()
    cv2.setNumThreads(1)
    furnish_session_folder(config, folder)
    trial = VirtualTrial(config, participant_seed, folder, wall_start_ns)
    try:
        outcome = trial.run()
    finally:
        trial.close()
    save_summary(summarise(read_log(folder / LOG_NAME)), folder)
    return outcome
