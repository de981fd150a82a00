"""summary.json as it stands in a session's folder."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from tams_app.errors import LogError
from tams_app.recording import SessionLog
from tams_app.summary.summarise import summarise

SUMMARY_NAME = "summary.json"
BEFORE_NAME = "summary.json.before"


def save_summary(log: SessionLog, folder: Path) -> dict[str, Any]:
    """Compute the summary of `log`, write it into `folder` and return it; LogError if it cannot.

    A complete summary is not lost to one of a log that has since been damaged: it is kept beside
    as `summary.json.before`.
    """
    summary = summarise(log)
    text = json.dumps(summary, indent=2) + "\n"
    path = folder / SUMMARY_NAME
    try:
        if not log.complete and _is_complete(path):
            os.replace(path, folder / BEFORE_NAME)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise LogError(f"{folder}: the summary cannot be written: {error.strerror}") from error
    return summary


def _is_complete(path: Path) -> bool:
    """Whether a summary is there that says nothing else; up to 0.1 they did not say."""
    try:
        former = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(former, dict) and former.get("complete", True) is True
