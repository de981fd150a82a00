"""What the calibration is for: a rig whose frame is not known cannot be driven, and then can."""

from itertools import islice

import pytest
import yaml
from scipy.spatial.transform import Rotation

from calibration.frame.result import rows
from calibration.frame.wizard import FrameWizard
from calibration.options import FrameOptions
from tams_app.config import load_config
from tams_app.session.virtual.videoless import VideolessTrial
from tests.scripted_ui import ScriptedUI

pytestmark = [pytest.mark.untimed, pytest.mark.verify]

TRIAL_SEED = 6  # a quick one


@pytest.mark.timeout(900)
def test_a_rig_turned_at_random_is_drivable_again_once_calibrated(tmp_path):
    turned = [list(row) for row in rows(Rotation.random(random_state=0).as_matrix())]
    path = tmp_path / "lab.yaml"
    path.write_text(
        yaml.safe_dump(
            {
                "version": 1,
                "include": ["networks.yaml", "weights.yaml"],
                "calibration": "lab",
                "control": {"rate_hz": 30},  # a quarter of the usual, for the time that it takes
                "rig": {
                    "hand_rotation": turned,
                    "wiring": {"a": "b/click", "b": "a/click"},
                },
            }
        )
    )
    uncalibrated = load_config(path)
    options = FrameOptions(config=path, sim=True, yes=True)
    assert FrameWizard(ScriptedUI(), options).run() == 0
    config = load_config(path)
    assert config.calibrated_by[0].startswith("frame-")

    after = VideolessTrial(config, TRIAL_SEED)
    steps = len(list(after.perform()))
    assert after._trial.outcome("").success

    before = VideolessTrial(uncalibrated, TRIAL_SEED)
    assert len(list(islice(before.perform(), steps + 1))) > steps  # it goes on
    assert not before._trial.outcome("").success
