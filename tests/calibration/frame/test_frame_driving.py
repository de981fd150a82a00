"""What the calibration is for: a rig whose frame is not known cannot be driven, and then can."""

import pytest
import yaml
from scipy.spatial.transform import Rotation

from calibration.frame.result import rows
from calibration.frame.wizard import FrameWizard
from calibration.options import FrameOptions
from tams_app.config import load_config
from tests.calibration.frame.driving import drive
from tests.scripted_ui import ScriptedUI

pytestmark = pytest.mark.untimed

LONG_ENOUGH_S = 28.0  # the same operator places the block after 20 s on a rig that is right


@pytest.mark.timeout(900)
@pytest.mark.parametrize("seed", [0])
def test_a_rig_turned_at_random_is_drivable_again_once_calibrated(tmp_path, seed):
    turned = [list(row) for row in rows(Rotation.random(random_state=seed).as_matrix())]
    path = tmp_path / "lab.yaml"
    path.write_text(
        yaml.safe_dump(
            {
                "version": 1,
                "include": ["networks.yaml", "weights.yaml"],
                "calibration": "lab",
                "control": {"rate_hz": 60},  # half the usual, for the time that it takes
                "rig": {
                    "hand_rotation": turned,
                    "wiring": {"a": "b/click", "b": "a/click"},
                },
            }
        )
    )
    before = drive(load_config(path), LONG_ENOUGH_S)
    assert not before.success

    options = FrameOptions(config=path, sim=True, yes=True, seed=seed)
    assert FrameWizard(ScriptedUI(), options).run() == 0

    config = load_config(path)
    assert config.calibrated_by[0].startswith("frame-")
    after = drive(config, LONG_ENOUGH_S)
    assert after.reason == "placed"
    assert after.success
