"""The summary of a session: `summarise` turns a log into the numbers of summary.json."""

from tams_app.summary.summarise import summarise

__all__ = ["summarise"]
