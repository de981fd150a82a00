"""The interface between a study and what runs its trials, live or simulated."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from tams_app.study.plan import PlannedTrial

SUMMARY_NAME = "summary.json"
LOG_NAME = "session.mcap"


class TrialRunner(Protocol):
    """Runs one trial. Pickled into a process of its own where trials run in parallel."""

    def run(self, trial: PlannedTrial, folder: Path) -> None:
        """Leave summary.json and the log in `folder`, which exists and is empty but for logs.

        Raises TamsError, a sentence, where the trial cannot be run.
        """
