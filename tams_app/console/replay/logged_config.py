"""The configuration of a session that was recorded."""

from __future__ import annotations

from pathlib import Path

from pydantic import ValidationError

from tams_app.config import Config
from tams_app.errors import UnreadableLogError
from tams_app.recording import SessionLog


def logged_config(log: SessionLog, path: Path) -> Config:
    """As `log`, read from `path`, has it; UnreadableLogError if this version has other keys."""
    try:
        return Config.model_validate(log.header.config)
    except ValidationError as error:
        raise UnreadableLogError(
            f"{path}: its configuration is of another version of TAMS; use that to replay it"
        ) from error
