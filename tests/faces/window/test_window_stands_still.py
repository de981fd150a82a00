"""A window that no longer takes in what is new tells nothing any more, though its process works."""

from __future__ import annotations

import time

import pytest

from tests.faces.window.conftest import ShownWindow
from tests.faces.window.facts import FACTS, changed
from tests.faces.window.xvfb import wait_for

pytestmark = pytest.mark.waiting


def test_what_fails_while_facts_are_taken_in_ends_its_signs_of_life(window: ShownWindow) -> None:
    window.show(changed(FACTS, t_s=time.monotonic()))
    assert wait_for(lambda: len(window.events) > 20)
    window.show(changed(FACTS, t_s="now"))  # which the window cannot read

    def is_silent() -> bool:
        heard = len(window.events)
        time.sleep(1.0)
        return len(window.events) == heard

    assert wait_for(is_silent)
    assert window.client.ended is False
