"""Where the camera on the arm is, for the processes that draw and score what it sees.

Memory that they share with the application, which never waits for them; and the check, where the
frames come in, of whether the camera is where it should be.
"""

from __future__ import annotations

import mmap
import os
import struct
from collections.abc import Mapping
from functools import partial
from typing import Any

import msgspec
import numpy as np

from tams_app.prediction.camera_check import CameraCheck
from tams_app.prediction.present import (
    UNKNOWN_JOINTS,
    MountTrail,
    PredictedCamera,
    Shown,
    WristView,
    array_of,
    numbers_of,
)
from tams_app.records import Image, MountPrediction, Pose, ShownFrame, TakeNote
from tams_app.rotation import Rotation
from tams_app.runtime.shared_ring import (
    RingShape,
    SharedRing,
    create_block,
    new_block_name,
    open_block,
    open_descriptor,
    remove_block,
)

_RECORD = struct.Struct("<qq7d7d7d6d6d?q??")  # the times, poses, joints, and the rest
_SHAPE = RingShape(head_bytes=_RECORD.size, heads=1024)  # eight seconds


class MountMemory:
    """The application's side; one thread puts.

    `name` is what a reader's process opens it by, or `descriptor`, which it inherits, where the
    name is hidden already. `cameras`: by view, those whose frames are to be corrected.
    `camera_fits`: whether the one on the arm is where it should be, as far as is known.
    """

    def __init__(self, cameras: Mapping[str, PredictedCamera]) -> None:
        self.cameras = cameras
        self.camera_fits = True
        self.name = f"{new_block_name()}-mount"
        self._memory = create_block(self.name, _SHAPE.size)
        self.descriptor = open_descriptor(self.name)
        self._ring = SharedRing(self._memory, _SHAPE)

    def put(self, placed: MountPrediction) -> None:
        """What is believed from now on."""
        self._ring.put(
            _RECORD.pack(
                placed.then_ns,
                placed.now_ns,
                *_numbers7(placed.then),
                *_numbers7(placed.now),
                *_numbers7(placed.now if placed.commanded is None else placed.commanded),
                *(UNKNOWN_JOINTS if placed.then_joints is None else placed.then_joints),
                *(UNKNOWN_JOINTS if placed.now_joints is None else placed.now_joints),
                placed.trusted,
                placed.offset_ns,
                placed.closed,
                placed.camera_fits,
            )
        )

    def specification(self) -> dict[str, Any]:
        """What a helper process makes `described_views` from, or a face `described_cameras`."""
        cameras = msgspec.to_builtins(self.cameras, enc_hook=numbers_of)
        return {"mount_memory": self.name, "cameras": cameras}

    def hide(self) -> None:
        """Take the name away, once all readers have it open: nothing is left behind then."""
        remove_block(self.name)

    def close(self) -> None:
        """Give the memory back; once, when nothing is put any more."""
        self.hide()
        os.close(self.descriptor)
        self._memory.close()


class PresentViews:
    """The views that are corrected, in a process that has the memory open."""

    def __init__(self, cameras: Mapping[str, PredictedCamera], block: mmap.mmap) -> None:
        self._trail = MountTrail()
        self._views = {view: camera.view(self._trail) for view, camera in cameras.items()}
        self._ring = SharedRing(block, _SHAPE)
        self._next = 0

    def on_arm(self, view: str) -> WristView:
        """That of a camera on the arm; `read` before each use. TypeError for any other."""
        found = self._views[view]
        if not isinstance(found, WristView):
            raise TypeError(f"{view} is not of a camera on the arm")
        return found

    def __contains__(self, view: str) -> bool:
        return view in self._views

    def show(self, view: str, image: Image, capture_ns: int, now_ns: int) -> Shown:
        """As `WristView.show`; KeyError for a view that is not corrected."""
        self.read()
        return self._views[view].show(image, capture_ns, now_ns)

    def read(self) -> None:
        """Take in what was put since."""
        written = self._ring.written()
        self._next = max(self._next, written - _SHAPE.heads + 1)  # the oldest may be half gone
        for number in range(self._next, written):
            head = self._ring.head(number)
            if head is not None:
                self._trail.add(_placed(head))
        self._next = written


def described_cameras(described: Mapping[str, Any]) -> dict[str, PredictedCamera]:
    """The `cameras` of a `MountMemory` from what its `specification` has of them."""
    return msgspec.convert(described, dict[str, PredictedCamera], dec_hook=array_of)


def described_views(specification: Mapping[str, Any]) -> dict[str, partial[Shown]]:
    """By view that is corrected, what shows its frames as `WristView.show` does."""
    name = str(specification["mount_memory"])
    if not name:
        return {}
    cameras = described_cameras(specification["cameras"])
    views = PresentViews(cameras, open_block(name))
    return {view: partial(views.show, view) for view in cameras}


def _numbers7(pose: Pose) -> tuple[float, ...]:
    """Position [m] and quaternion."""
    return (*pose.position.tolist(), *pose.rotation)


def _pose7(numbers: list[float]) -> Pose:
    return Pose(np.array(numbers[:3]), Rotation(*numbers[3:]))


def _placed(head: bytes) -> MountPrediction:
    then_ns, now_ns, *numbers = _RECORD.unpack(head)
    then, now, commanded = (_pose7(numbers[at : at + 7]) for at in (0, 7, 14))
    then_joints, now_joints = (np.array(numbers[at : at + 6]) for at in (21, 27))
    beside = (*numbers[33:], commanded, then_joints, now_joints)
    return MountPrediction(then_ns, then, now_ns, now, *beside)


MEASURE = "run_tams.py calibrate cameras --only lens,mount"


def misfit(view: str) -> str:
    """What is said once a camera is found not to be where it should be."""
    return (
        f"{view}: while the arm moves, the picture does not change as the camera's pose and lens "
        "say, so it is shown as received from now on; mount the camera as it was, or measure it: "
        f"{MEASURE}"
    )


class CameraWatch:
    """Reads where the arm was from the memory that all share, and tells it what is found."""

    def __init__(self, mount: MountMemory, note: TakeNote) -> None:
        """While `mount` has its name."""
        self._mount, self._note = mount, note
        self._checks: dict[str, tuple[PresentViews, CameraCheck]] = {}
        for view, camera in mount.cameras.items():
            if camera.on_arm:
                present = PresentViews({view: camera}, open_block(mount.name))
                self._checks[view] = present, CameraCheck(present.on_arm(view))

    def shown(self, frame: ShownFrame) -> None:
        """In the thread of the frame's view."""
        if frame.view not in self._checks:
            return
        present, check = self._checks[frame.view]
        present.read()
        if check.shown(frame):
            self._mount.camera_fits = False
            self._note("warning", misfit(frame.view))
