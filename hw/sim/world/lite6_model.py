"""The Lite 6 with its two-finger gripper and wrist camera as MJCF, from primitives.

Frames are those of the modified DH table (FINDINGS 8), so MuJoCo's flange is the controller's.
Masses, inertias and largest torques are those of UFACTORY's description (xarm_ros2,
lite6.urdf.xacro); servo gains, gripper dynamics and looks are ours. Geoms that others may touch
have contype ARM_BIT; the arm does not collide with itself, the controller guards that (C22).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from scipy.spatial.transform import Rotation

from hw.lite6.kinematics import JOINT_LOWER, JOINT_UPPER
from hw.sim.gripper import (
    CLIP_HALF,
    FINGER_TRAVEL_M,
    HOUSING,
    MARKER_HALF_M,
    PAD_HALF,
    PLATE,
    TCP_OFFSET_M,
)
from hw.sim.viewpoints import WRIST_VIEWPOINT

# Contact bits: fixed things touch nothing by themselves, block and arm name what they touch.
FIXED_BIT, BLOCK_BIT, ARM_BIT = 1, 2, 4
MOVING_GROUP = 1  # the fixed cameras redraw only this geom group

GRIP_FORCE_N = 8.0
JOINTS = tuple(f"joint{number}" for number in range(1, 7))


@dataclass(frozen=True, slots=True)
class Link:
    """One row of the modified DH table [m, rad] with what is fixed to its frame."""

    offset: float
    d: float
    alpha: float
    a: float
    mass: float
    centre: str
    inertia: str  # xx yy zz xy xz yz, about the centre of mass
    stiffness: float  # position servo [N·m/rad]
    damping: float  # [N·m·s/rad]
    torque: float  # largest [N·m]
    shapes: tuple[str, ...]


def _capsule(radius: float, ends: str, material: str = "shell") -> str:
    return f'type="capsule" size="{radius}" fromto="{ends}" material="{material}"'


def _cylinder(radius: float, ends: str, material: str = "shell") -> str:
    return f'type="cylinder" size="{radius}" fromto="{ends}" material="{material}"'


def _box(centre: Sequence[float], half: Sequence[float]) -> str:
    size, place = (" ".join(map(str, numbers)) for numbers in (half, centre))
    return f'type="box" size="{size}" pos="{place}"'


_Q = math.pi / 2
LINKS = (
    Link(0, 0.2433, 0, 0, 1.169, "-.00036 .03788 -.0027",
         "1.45164e-3 8.873e-4 1.31993e-3 1.24e-5 -6.7e-6 1.255e-4",
         6000, 110, 50,
         (_cylinder(0.050, "0 0 -.075 0 0 -.010"),
          _capsule(0.046, "0 -.030 0 0 .050 0"),
          _cylinder(0.047, "0 -.079 0 0 -.030 0", "joint"))),
    Link(-_Q, 0, -_Q, 0, 1.192, ".178 0 .0576",
         "1.5854e-3 5.6097e-3 4.85e-3 -6.766e-6 -1.15136e-3 1.14e-6",
         6000, 110, 50,
         (_capsule(0.037, "0 0 .088 .200 0 .088"),
          _cylinder(0.046, "0 0 .040 0 0 .122"),
          _cylinder(0.044, "0 0 .122 0 0 .132", "joint"),
          _cylinder(0.043, ".200 0 .046 .200 0 .122"),
          _cylinder(0.041, ".200 0 .122 .200 0 .131", "joint"),
          'type="box" size=".052 .021 .0382" pos=".100 0 .088" material="arm_print"')),
    Link(-_Q, 0, math.pi, 0.200, 0.930, ".07285 -.030 -.0009",
         "8.861e-4 1.5785e-3 1.84677e-3 -3.9287e-4 7.066e-5 -2.445e-5",
         6000, 90, 32,
         (_cylinder(0.042, "0 0 -.046 0 0 .034"),
          _cylinder(0.040, "0 0 .034 0 0 .041", "joint"),
          _capsule(0.036, "0 0 0 .087 0 0"),
          _capsule(0.036, ".087 0 0 .087 -.060 0"))),
    Link(0, 0.2276, _Q, 0.087, 1.31, "-.0004 -.0275 -.0817",
         "3.705e-3 3.0455e-3 1.5413e-3 -2.0e-6 7.17e-6 -9.3188e-4",
         3000, 45, 32,
         (_cylinder(0.036, "0 0 -.168 0 0 -.160", "joint"),
          _cylinder(0.035, "0 0 -.160 0 0 -.045"),
          _capsule(0.034, "0 0 -.045 0 -.012 -.010"),
          _capsule(0.034, "0 -.030 0 0 .022 0", "joint"))),
    Link(0, 0, _Q, 0, 0.784, "0 .010 .0019",
         "5.668e-4 5.077e-4 5.3e-4 6e-7 -5.3e-6 -4.8e-7",
         3000, 45, 32,
         (_capsule(0.033, "0 -.010 0 0 .010 0"),
          _cylinder(0.034, "0 .008 0 0 .034 0"))),
    Link(0, 0.0615, -_Q, 0, 0.180, "0 -.00194 -.0102",
         "7.726e-5 8.5665e-5 1.4814e-4 1e-6 4e-7 -6e-7",
         3000, 40, 20,
         (_cylinder(0.032, "0 0 -.026 0 0 -.003", "joint"),
          _cylinder(0.031, "0 0 -.003 0 0 0"))),
)  # fmt: skip

_VISUAL = f'mass="0" group="{MOVING_GROUP}" contype="0" conaffinity="0"'
_TOUCH = f'mass="0" group="{MOVING_GROUP}" contype="{ARM_BIT}" conaffinity="{FIXED_BIT}"'
_PAD = f'{_TOUCH} condim="4" friction="1.5 .05 .001" solref=".002 1" solimp=".95 .99 .0005"'


def arm_body() -> str:
    """The arm as one MJCF body, base at the world's origin, looking along +x."""
    inner = _gripper() + _wrist_camera()
    for number in range(len(LINKS), 0, -1):
        inner = _link_body(number, LINKS[number - 1], inner)
    return f"""
<body name="base" childclass="arm">
 <geom type="cylinder" size=".068 .010" pos="0 0 .010" material="joint" {_TOUCH}/>
 <geom type="cylinder" size=".062 .052" pos="0 0 .072" material="shell" {_TOUCH}/>
 <geom type="cylinder" size=".055 .022" pos="0 0 .146" material="joint" {_VISUAL}/>
 <geom type="box" size=".0015 .026 .030" pos=".0612 0 .074" material="arm_print" {_VISUAL}/>
 {inner}
</body>"""


def _link_body(number: int, link: Link, inner: str) -> str:
    sine, cosine = math.sin(link.alpha), math.cos(link.alpha)
    turn = Rotation.from_rotvec([link.alpha, 0, 0]) * Rotation.from_rotvec([0, 0, link.offset])
    x, y, z, w = turn.as_quat().tolist()
    place = f"{link.a!r} {-link.d * sine!r} {link.d * cosine!r}"
    touch = _TOUCH if number >= 4 else _VISUAL  # what can reach the table first
    shapes = "\n ".join(f"<geom {shape} {touch}/>" for shape in link.shapes)
    return f"""
<body name="link{number}" pos="{place}" quat="{w!r} {x!r} {y!r} {z!r}" gravcomp="1">
 <inertial pos="{link.centre}" mass="{link.mass}" fullinertia="{link.inertia}"/>
 <joint name="joint{number}" range="{_range(number)}"/>
 {shapes}
 {inner}
</body>"""


def _range(number: int) -> str:
    return f"{JOINT_LOWER[number - 1]} {JOINT_UPPER[number - 1]}"


def _gripper() -> str:
    """Housing, two coupled fingers and the TCP site, in the flange frame."""
    edge, marker = MARKER_HALF_M, f'material="gripper_marker" {_VISUAL}'
    return f"""
<body name="gripper" gravcomp="1"><inertial pos="0 0 .026" mass=".26" diaginertia=".00016 .00012
  .00014"/>
 <geom type="cylinder" size=".030 .003" pos="0 0 .003" material="joint" {_TOUCH}/>
 <geom {_box(*HOUSING)} material="housing" {_TOUCH}/>
 <geom {_box(*PLATE)} material="joint" {_TOUCH}/>
 <geom type="box" size=".0006 {edge} {edge}" pos=".0184 0 .027" {marker}/>
 <geom type="box" size="{edge} .0006 {edge}" pos="0 .0344 .027" {marker}/>
 <geom type="box" size="{edge} .0006 {edge}" pos="0 -.0344 .027" {marker}/>
 <site name="tcp" pos="0 0 {TCP_OFFSET_M}" size=".001" group="4"/>
 {_finger("left", -1)}
 {_finger("right", 1)}
</body>"""


def _finger(name: str, side: int) -> str:
    """A finger whose joint coordinate runs from 0 (open) to FINGER_TRAVEL_M (closed)."""
    return f"""
<body name="finger_{name}" pos="0 {side * FINGER_TRAVEL_M} .053" gravcomp="1">
 <inertial pos="0 0 .014" mass=".024" diaginertia="2e-6 2e-6 1e-6"/>
 <joint name="finger_{name}" type="slide" axis="0 {-side} 0" range="0 {FINGER_TRAVEL_M + 0.0001}"
  damping="60" armature=".2" frictionloss=".2" solreflimit=".002 1" solimplimit=".95 .999 .0002"/>
 <geom type="box" size=".0055 .0030 .009" pos="0 {side * 0.0070} .008" material="joint" {_VISUAL}/>
 <geom name="pad_{name}" {_box((0, side * PAD_HALF[1], 0.022), PAD_HALF)}
  material="fingertip" {_PAD}/>
 <geom {_box((0, side * 0.0072, 0.022), CLIP_HALF)} material="joint" {_VISUAL}/>
</body>"""


def _wrist_camera() -> str:
    """The eye-in-hand camera with its bracket; it sees the fingers and what is between them."""
    x, y, z = WRIST_VIEWPOINT.place
    tilt = math.radians(WRIST_VIEWPOINT.tilt_deg)
    axes = f"0 1 0 {math.cos(tilt):.6f} 0 {-math.sin(tilt):.6f}"
    body_x, body_z = x - 0.013 * math.sin(tilt), z - 0.013 * math.cos(tilt)
    return f"""
<camera name="eih" pos="{x} {y} {z}" xyaxes="{axes}" fovy="{WRIST_VIEWPOINT.fovy_deg}"/>
<geom type="box" size=".012 .042 .010" pos="{body_x:.5f} 0 {body_z:.5f}"
 euler="0 {tilt:.5f} 0" material="joint" {_VISUAL}/>
<geom type="box" size=".018 .014 .0025" pos="-.038 0 .0025" material="joint" {_VISUAL}/>"""


def arm_defaults() -> str:
    return '<default class="arm"><joint axis="0 0 1" armature=".1"/></default>'


def arm_actuators() -> str:
    """Position servos of the joints, then the grip motor (positive closes)."""
    servos = "\n".join(
        f'<position name="{name}" joint="{name}" kp="{link.stiffness}" kv="{link.damping}" '
        f'forcerange="{-link.torque} {link.torque}"/>'
        for name, link in zip(JOINTS, LINKS, strict=True)
    )
    return f"""{servos}
<motor name="grip" joint="finger_left" ctrlrange="{-GRIP_FORCE_N} {GRIP_FORCE_N}"/>"""


def finger_coupling() -> str:
    return """<joint joint1="finger_right" joint2="finger_left" polycoef="0 1 0 0 0"
 solref=".005 1"/>"""
