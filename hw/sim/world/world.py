"""The world of the simulated rig: MuJoCo under position servos, the plant of the controller model.

Deterministic: the same layout and the same calls give the same world, bit for bit.
"""

from __future__ import annotations

import mujoco
import numpy as np

from hw.arm import PlantState
from hw.sim.layout import FINGER_TRAVEL_M, Layout
from hw.sim.world.rig_memory import WorldState
from hw.sim.world.scene import build_model
from tams_app.records import SceneTruth, Vector

# External torque on a joint [N·m] that reads as a collision, and for how long it must last.
# Ours, not the Lite 6's: pick and place stays below 0.8 N·m (measured here), and a push of 34 N
# 0.35 m from the axis makes 12.
COLLISION_TORQUE_NM: Vector = np.array([12.0, 12.0, 12.0, 6.0, 6.0, 6.0])
COLLISION_TIME_NS = 12_000_000

STEP_NS = 1_000_000  # of the physics
GRIP_FORCE_N = 8.0
JOINTS = tuple(f"joint{number}" for number in range(1, 7))

_XYZW = [1, 2, 3, 0]  # MuJoCo puts the quaternion's w first

_DRIVE_FORCE_N = {
    None: 0.0,
    False: -GRIP_FORCE_N,
    True: GRIP_FORCE_N,
}


class World:
    """The scene of `layout` with the arm at `start_joints` [rad], shape (6,), fingers open.

    Implements `Plant`. Not thread safe.
    """

    def __init__(self, layout: Layout, start_joints: Vector) -> None:
        self._model = build_model(layout, textured=False)
        self._data = mujoco.MjData(self._model)
        model = self._model
        self._joint_places = np.array([int(model.joint(name).qposadr[0]) for name in JOINTS])
        self._speed_places = np.array([int(model.joint(name).dofadr[0]) for name in JOINTS])
        self._finger_place = int(model.joint("finger_left").qposadr[0])
        self._block_speed_place = int(model.joint("block").dofadr[0])
        stiffness, damping = -model.actuator_biasprm[: len(JOINTS), 1:3].T
        self._lead_s = damping / stiffness
        self._block, self._container = model.body("block").id, model.body("container").id
        self._gripper, self._tcp = model.body("gripper").id, model.site("tcp").id
        self._last_target = np.asarray(start_joints, float).copy()
        self._strained_ns = 0
        self._data.qpos[self._joint_places] = start_joints
        self._data.ctrl[: len(JOINTS)] = start_joints
        mujoco.mj_forward(self._model, self._data)

    @property
    def joints(self) -> Vector:
        """Measured joints [rad], shape (6,)."""
        joints: Vector = self._data.qpos[self._joint_places]
        return joints

    @property
    def qpos(self) -> Vector:
        """All that a renderer needs to draw the world, shape (nq,)."""
        qpos: Vector = self._data.qpos.copy()
        return qpos

    def step(self, joints_target: Vector, closing: bool | None, duration_ns: int) -> PlantState:
        """Advance by `duration_ns`, whole milliseconds, towards `joints_target` [rad]."""
        steps, rest = divmod(duration_ns, STEP_NS)
        if rest or steps <= 0:
            raise ValueError(f"duration_ns must be a positive multiple of {STEP_NS}")
        data, count = self._data, len(JOINTS)
        start, self._last_target = self._last_target, np.asarray(joints_target, float).copy()
        # The servo damps the joint's speed; a lead on the target makes it damp the speed's error.
        lead = self._lead_s * (self._last_target - start) / (duration_ns / 1e9)
        data.ctrl[count] = _DRIVE_FORCE_N[closing]
        for done in range(1, steps + 1):
            data.ctrl[:count] = start + (self._last_target - start) * (done / steps) + lead
            mujoco.mj_step(self._model, data)
            self._watch_for_collision()
        return PlantState(self.joints, collision=self._strained_ns >= COLLISION_TIME_NS)

    def state(self) -> WorldState:
        """This instant as bare numbers."""
        data, place = self._data, self._block_speed_place
        opening = 2.0 * (FINGER_TRAVEL_M - float(data.qpos[self._finger_place]))
        poses = np.empty((3, 7))
        for row, body in enumerate((self._block, self._container)):
            poses[row, :3] = data.xpos[body]
            poses[row, 3:] = data.xquat[body][_XYZW]
        poses[2, :3] = data.site_xpos[self._tcp]
        poses[2, 3:] = data.xquat[self._gripper][_XYZW]
        speed = float(np.linalg.norm(data.qvel[place : place + 3]))
        return WorldState(data.qpos.copy(), poses, speed, max(0.0, opening))

    def truth(self, now_ns: int) -> SceneTruth:
        """Where things are, stamped `now_ns`."""
        return self.state().truth(now_ns)

    def _watch_for_collision(self) -> None:
        """The arm's joints feel contacts and their own end stops as constraint torques."""
        torque = np.abs(self._data.qfrc_constraint[self._speed_places])
        strained = bool((torque > COLLISION_TORQUE_NM).any())
        self._strained_ns = self._strained_ns + STEP_NS if strained else 0
