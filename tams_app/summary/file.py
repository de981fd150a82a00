"""summary.json as it stands in a session's folder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tams_app.errors import LogError
from tams_app.recording import SessionLog
from tams_app.summary.summarise import summarise

SUMMARY_NAME = "summary.json"


def save_summary(log: SessionLog, folder: Path) -> dict[str, Any]:
    """Compute the summary of `log`, write it into `folder` and return it; LogError if it cannot."""
    summary = summarise(log)
    text = json.dumps(summary, indent=2) + "\n"
    try:
        (folder / SUMMARY_NAME).write_text(text, encoding="utf-8")
    except OSError as error:
        raise LogError(f"{folder}: the summary cannot be written: {error.strerror}") from error
    return summary
