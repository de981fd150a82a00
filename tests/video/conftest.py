"""A GStreamer or GLib critical anywhere in a video test is a failure of that test."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tams_app.video import gst


@pytest.fixture(autouse=True)
def glib_complaints() -> Iterator[list[str]]:
    """Criticals and warnings of GLib's log; a test that provokes one clears the list."""
    glib = gst.load().GLib
    complaints: list[str] = []
    levels = glib.LogLevelFlags.LEVEL_CRITICAL | glib.LogLevelFlags.LEVEL_WARNING

    def note(domain: str, level: object, message: str, *_: object) -> None:
        complaints.append(f"{domain}: {message}")

    domains = ("GStreamer", "GLib", "GLib-GObject", "GLib-GIO")
    handlers = [(domain, glib.log_set_handler(domain, levels, note, None)) for domain in domains]
    yield complaints
    for domain, handler in handlers:
        glib.log_remove_handler(domain, handler)
    assert complaints == []
