"""A calibration of the cameras by an earlier version."""

import pytest

from tams_app.config import load_config

pytestmark = pytest.mark.untimed

OLD_FILE = """\
calibration:
  kind: cameras
  made: '2026-11-01T12:00:00+00:00'
  tams: 0.9.0
  source: the cameras of this machine, moved and shown things by a person
  simulated: false
  quality:
    gt: {camera: Webcam, light_to_capture_ms: 31.0, clock_offset_ms: 2.0, intrinsics_rms_px: 0.2,
      intrinsics_file: intrinsics-gt-20261101T120000Z.yaml}
  replaces: null
config:
  cameras:
    gt: {source: v4l2, name: '', serial: S2, path: '', file: '', pixel_format: mjpeg,
      exposure_us: 8000, white_balance_k: 4000}
"""


@pytest.fixture
def lab(tmp_path):
    """A laboratory's configuration with a calibration of an earlier version in force."""
    path = tmp_path / "lab.yaml"
    path.write_text("version: 1\ninclude: [lite6.yaml]\ncalibration: lab\n")
    folder = tmp_path / "calibration" / "lab"
    folder.mkdir(parents=True)
    (folder / "cameras-20261101T120000Z.yaml").write_text(OLD_FILE)
    (folder / "in-force.yaml").write_text("cameras: cameras-20261101T120000Z.yaml\n")
    return path


def test_a_calibration_of_an_earlier_version_is_read_and_adds_nothing(lab):
    config = load_config(lab)
    assert (config.cameras["gt"].serial, config.cameras["gt"].exposure_us) == ("S2", 8000)
    assert config.cameras["gt"].latency_ms == 0.0
