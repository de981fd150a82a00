"""The world of the simulated rig: MuJoCo under position servos, the plant of the controller model.

Deterministic: the same layout and the same calls give the same world, bit for bit.
"""

from __future__ import annotations

import math

import mujoco

from hw.arm import PlantState
from hw.sim.layout import FINGER_TRAVEL_M, Layout
from hw.sim.world.rig_memory import WorldState
from hw.sim.world.scene import build_model
from tams_app.records import SceneTruth, Vector
from tams_app.vectors import Joints, Numbers, plain

# External torque on a joint [N·m] that reads as a collision, and for how long it must last.
# Ours, not the Lite 6's: pick and place stays below 0.8 N·m (measured here), and a push of 34 N
# 0.35 m from the axis makes 12.
COLLISION_TORQUE_NM = (12.0, 12.0, 12.0, 6.0, 6.0, 6.0)
COLLISION_TIME_NS = 12_000_000

STEP_NS = 1_000_000  # of the physics
GRIP_FORCE_N = 8.0
JOINTS = tuple(f"joint{number}" for number in range(1, 7))

_NO_TORQUE = [0.0] * len(JOINTS)
_DRIVE_FORCE_N = {
    None: 0.0,
    False: -GRIP_FORCE_N,
    True: GRIP_FORCE_N,
}


class World:
    """The scene of `layout` with the arm at `start_joints` [rad], fingers open.

    Implements `Plant`. Not thread safe.
    """

    def __init__(self, layout: Layout, start_joints: Numbers) -> None:
        self._model = build_model(layout, textured=False)
        self._data = data = mujoco.MjData(self._model)
        model, count = self._model, len(JOINTS)
        # views of the data, of which the arm's joints are the first; lists of them are quick
        self._qpos = memoryview(data.qpos)
        self._ctrl: memoryview[float] = memoryview(data.ctrl).cast("B").cast("d")
        self._torques = memoryview(data.qfrc_constraint)[:count]
        self._finger_place = int(model.joint("finger_left").qposadr[0])
        block_speed = int(model.joint("block").dofadr[0])
        self._block_speed = memoryview(data.qvel)[block_speed : block_speed + 3]
        stiffness, damping = -model.actuator_biasprm[:count, 1:3].T
        self._lead_s = (damping / stiffness).tolist()
        self._block = model.joint("block")
        block, container = model.body("block").id, model.body("container").id
        gripper, tcp = model.body("gripper").id, model.site("tcp").id
        self._poses = [
            (memoryview(place), memoryview(turn))
            for place, turn in (
                (data.xpos[block], data.xquat[block]),
                (data.xpos[container], data.xquat[container]),
                (data.site_xpos[tcp], data.xquat[gripper]),
            )
        ]
        self._last_target = plain(start_joints)
        self._strained_ns = 0
        data.qpos[:count] = data.ctrl[:count] = start_joints
        mujoco.mj_forward(self._model, data)

    @property
    def joints(self) -> Joints:
        """As measured [rad]."""
        return tuple(self._qpos[: len(JOINTS)].tolist())

    @property
    def qpos(self) -> Vector:
        """All that a renderer needs to draw the world, shape (nq,)."""
        qpos: Vector = self._data.qpos.copy()
        return qpos

    def step(self, joints_target: Joints, closing: bool | None, duration_ns: int) -> PlantState:
        """Advance by `duration_ns`, whole milliseconds, towards `joints_target` [rad]."""
        steps, rest = divmod(duration_ns, STEP_NS)
        if rest or steps <= 0:
            raise ValueError(f"duration_ns must be a positive multiple of {STEP_NS}")
        start, self._last_target = self._last_target, joints_target
        duration_s, ctrl, count = duration_ns / 1e9, self._ctrl, len(JOINTS)
        # The servo damps the joint's speed; a lead on the target makes it damp the speed's error.
        joints = [
            (place, target - place, lead_s * (target - place) / duration_s)
            for place, target, lead_s in zip(start, self._last_target, self._lead_s, strict=True)
        ]
        ctrl[count] = _DRIVE_FORCE_N[closing]
        for done in range(1, steps + 1):
            part = done / steps
            for number, (place, way, lead) in enumerate(joints):
                ctrl[number] = place + way * part + lead
            mujoco.mj_step(self._model, self._data)
            self._watch_for_collision()
        return PlantState(self.joints, collision=self._strained_ns >= COLLISION_TIME_NS)

    def put_back(self) -> bool:
        """Put the block back to its start, at rest, out of the gripper if it is there.

        False, and the block stays, while something is in the way there.
        """
        model, data = self._model, self._data
        place, speed = int(self._block.qposadr[0]), int(self._block.dofadr[0])
        places, speeds = slice(place, place + 7), slice(speed, speed + 6)
        before = data.qpos[places].copy(), data.qvel[speeds].copy()
        data.qpos[places], data.qvel[speeds] = model.qpos0[places], 0.0
        mujoco.mj_forward(model, data)
        if is_free := not self._is_touched():
            return is_free
        data.qpos[places], data.qvel[speeds] = before
        mujoco.mj_forward(model, data)
        return is_free

    def _is_touched(self) -> bool:
        """True if the block touches anything that can move."""
        model = self._model
        body_of_geom = model.body_weldid[model.geom_bodyid]  # 0: fixed
        pairs = body_of_geom[self._data.contact.geom]
        return bool(((pairs == model.body("block").id).any(1) & pairs.all(1)).any())

    def state(self) -> WorldState:
        """This instant as bare numbers."""
        opening = 2.0 * (FINGER_TRAVEL_M - self._qpos[self._finger_place])
        poses = []
        for place, turn in self._poses:
            w, *xyz = turn.tolist()
            poses.append((*place.tolist(), *xyz, w))
        speed = math.hypot(*self._block_speed.tolist())
        return WorldState(tuple(self._qpos.tolist()), tuple(poses), speed, max(0.0, opening))

    def truth(self, now_ns: int) -> SceneTruth:
        """The places of things, stamped `now_ns`."""
        return self.state().truth(now_ns)

    def _watch_for_collision(self) -> None:
        """The arm's joints feel contacts and their own end stops as constraint torques."""
        torques = self._torques.tolist()
        strained = torques != _NO_TORQUE and any(
            abs(torque) > most for torque, most in zip(torques, COLLISION_TORQUE_NM, strict=True)
        )
        self._strained_ns = self._strained_ns + STEP_NS if strained else 0
