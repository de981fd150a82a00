"""What the calibration is for: a rig whose frame is not known cannot be driven, and then can."""

from itertools import islice

import pytest
from scipy.spatial.transform import Rotation

from tams_app.config import load_config
from tams_app.session.virtual.videoless import VideolessTrial
from tests.calibration.frame.test_frame_wizard import SWAPPED, calibrate, write_rig

pytestmark = [pytest.mark.untimed, pytest.mark.verify]

TRIAL_SEED = 6  # a quick one


@pytest.mark.timeout(900)
def test_a_rig_turned_at_random_is_drivable_again_once_calibrated(tmp_path):
    turned = Rotation.random(random_state=0).as_matrix()
    # a quarter of the usual rate, for the time that it takes
    path = write_rig(tmp_path, turned, SWAPPED, control={"rate_hz": 30})
    uncalibrated = load_config(path)
    assert calibrate(path, buttons=True)[0] == 0
    config = load_config(path)
    assert config.calibrated_by[0].startswith("frame-")

    after = VideolessTrial(config, TRIAL_SEED)
    steps = len(list(after.perform()))
    assert after._trial.outcome("").success

    before = VideolessTrial(uncalibrated, TRIAL_SEED)
    assert len(list(islice(before.perform(), steps + 1))) > steps  # it goes on
    assert not before._trial.outcome("").success
