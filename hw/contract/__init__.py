"""The contracts of devices, for the authors of drivers: `check_arm`, `check_camera`,
`check_controller`.

Each checks one promise after the other on a device of its own and raises `ContractError` with a
line for each that is not kept. TAMS holds its own drivers to the same, and to more that needs a
device which can be made to fail (`tests/contract`).
"""

from hw.contract.arm import ARM_PROMISES, ArmBench, check_arm
from hw.contract.camera import CAMERA_PROMISES, CameraBench, check_camera
from hw.contract.controller import CONTROLLER_PROMISES, ControllerBench, check_controller
from hw.contract.promise import ContractError, Promise

__all__ = [
    "ARM_PROMISES",
    "CAMERA_PROMISES",
    "CONTROLLER_PROMISES",
    "ArmBench",
    "CameraBench",
    "ContractError",
    "ControllerBench",
    "Promise",
    "check_arm",
    "check_camera",
    "check_controller",
]
