"""What tests of several wizards need: a configuration of the rig, and a screen."""

import pytest

from tests.calibration.lab import write_lab
from tests.faces.window.xvfb import virtual_screen


@pytest.fixture
def config_path(tmp_path):
    """A configuration of the rig whose set of calibrations is `lab`."""
    return write_lab(tmp_path)


@pytest.fixture
def screen(tmp_path, monkeypatch):
    """What a display shows that no one sits at."""
    with virtual_screen(tmp_path, monkeypatch, 1024, 768, "-noreset") as found:
        yield found
