"""The whole configuration as typed models; keys carry their unit."""

from tams_app.config.devices import (
    CameraConfig,
    ControllerConfig,
    DeskConfig,
    HeadsetConfig,
    LensConfig,
    MappingConfig,
    MountConfig,
)
from tams_app.config.motion import (
    ArmConfig,
    HandConfig,
    LimitsConfig,
    ProfileConfig,
    stop_time_s,
)
from tams_app.config.reader import dump_config, load_config
from tams_app.config.streaming import (
    BudgetConfig,
    LinkConfig,
    Network,
    PhasesConfig,
    PolicyConfig,
    RepairConfig,
    VideoConfig,
)
from tams_app.config.whole import (
    Config,
    OperatorConfig,
    OperatorKind,
    TrialConfig,
)
from tams_app.config.yaml_file import CONFIG_DIRECTORY, DEFAULT_CONFIG

__all__ = [
    "CONFIG_DIRECTORY",
    "DEFAULT_CONFIG",
    "ArmConfig",
    "BudgetConfig",
    "CameraConfig",
    "Config",
    "ControllerConfig",
    "DeskConfig",
    "HandConfig",
    "HeadsetConfig",
    "LensConfig",
    "LimitsConfig",
    "LinkConfig",
    "MappingConfig",
    "MountConfig",
    "Network",
    "OperatorConfig",
    "OperatorKind",
    "PhasesConfig",
    "PolicyConfig",
    "ProfileConfig",
    "RepairConfig",
    "TrialConfig",
    "VideoConfig",
    "dump_config",
    "load_config",
    "stop_time_s",
]
