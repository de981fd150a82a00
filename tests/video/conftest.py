"""A GStreamer or GLib critical anywhere in a video test is a failure of that test."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def _no_glib_complaints(glib_complaints: list[str]) -> None:
    """Nothing to do but to listen."""
