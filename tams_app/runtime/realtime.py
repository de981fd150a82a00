"""Real-time priorities, where the system allows them, and memory that is kept for images.

| what | policy | why |
|---|---|---|
| guard | FIFO 60 | it must run when the control loop spins |
| control loop | FIFO, `control.realtime_priority` (50) | 120 Hz |
| the arm driver's threads | one below the control loop | a command's way out and back |
| link relay | FIFO 20 | its delays are what it is for |
| all other threads of the application | round robin 1 | see below |
| the rig's world | FIFO 5 | simulated time must keep up with the wall's |
| the simulated operator's hand | FIFO 5 | it stands for a VR runtime |
| the simulated operator's eyes | round robin 1 | they share the GIL with the hand, and rest a lot |
| renderer | ordinary, nice -10, else 10 | it fills a core: see below |
| window, headset | ordinary, nice -10 | what they show must not wait; they limit themselves |
| the ROS 2 bridge | ordinary, nice 5 | what it publishes may wait |
| quality | idle | it takes what is left over |

The application's threads share the GIL: one that is pushed off its core while it holds the GIL
holds up the control loop, whatever that one's priority. So none of them runs below real time.
What can fill a core must not run above ordinary processes: where these starve, the kernel takes
the cores from everything real-time for 50 ms of every second (sched_rt_runtime_us; since Linux 6.8
the fair server), and the thread that holds the GIL then stands still. For the same reason a helper
loads its modules as an ordinary process, and takes its priority when it is about to work.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
from collections.abc import Iterable, Iterator

GUARD_PRIORITY = 60
RELAY_PRIORITY = 20
APPLICATION_PRIORITY = 1
RIG_PRIORITY = 5
OPERATOR_PRIORITY = 5
RENDERER_NICE = -10
WINDOW_NICE = -10
ROS2_NICE = 5

_LOWEST_NICE = 19

NOT_ASKED_FOR = "other: not asked for"
NOT_KNOWN = "other: this system has no real-time policies"
NOT_PERMITTED = "other: not permitted (see run_tams.py doctor)"


def use_fifo(priority: int, thread_id: int = 0) -> str:
    """Put a thread (default: the calling one) under SCHED_FIFO at `priority`; 0 leaves it alone.

    Returns "fifo", or why not ("other: ..."); TAMS runs without it too.
    """
    return _use("SCHED_FIFO", "fifo", priority, thread_id)


def use_round_robin(priority: int) -> str:
    """Put the calling thread, and all it will start, under SCHED_RR; see `use_fifo`."""
    return _use("SCHED_RR", "rr", priority, 0)


def use_nice(wanted: int, otherwise: int) -> None:
    """Give the calling process the niceness `wanted`, or where that is refused `otherwise`.

    What was started nicer than `otherwise` stays so: it may not go back without privileges.
    """
    if not hasattr(os, "setpriority"):
        return
    try:
        os.setpriority(os.PRIO_PROCESS, 0, wanted)
    except PermissionError:
        given = os.getpriority(os.PRIO_PROCESS, 0)
        os.setpriority(os.PRIO_PROCESS, 0, max(given, otherwise))


def use_idle() -> None:
    """Run the calling process only where a core is free; lowering oneself is always allowed."""
    if hasattr(os, "SCHED_IDLE"):
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    else:
        use_nice(_LOWEST_NICE, _LOWEST_NICE)


def copy_scheduling(from_thread_id: int, to_thread_ids: Iterable[int]) -> None:
    """Schedule threads that replace others as those were; threads that have ended are left out."""
    if not hasattr(os, "sched_getscheduler"):
        return
    with contextlib.suppress(PermissionError, ProcessLookupError):
        policy = os.sched_getscheduler(from_thread_id)
        parameters = os.sched_getparam(from_thread_id)
        for thread_id in to_thread_ids:
            os.sched_setscheduler(thread_id, policy, parameters)


def use_ordinary() -> None:
    """Give up what was inherited from a real-time parent; lowering oneself is always allowed.

    A program that was started as `chrt --idle` or `--batch` stays what it is.
    """
    if not hasattr(os, "sched_setscheduler"):
        return
    if os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK in (os.SCHED_FIFO, os.SCHED_RR):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


@contextlib.contextmanager
def ordinary_meanwhile() -> Iterator[None]:
    """Let the calling thread be an ordinary one for as long as it starts a process.

    A process inherits the policy of the thread that starts it, and loads its modules under it.
    """
    if not hasattr(os, "sched_getscheduler"):
        yield
        return
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    use_ordinary()
    try:
        yield
    finally:
        if os.sched_getscheduler(0) != policy:
            with contextlib.suppress(PermissionError):
                os.sched_setscheduler(0, policy, parameters)


def _use(policy: str, name: str, priority: int, thread_id: int) -> str:
    if priority == 0:
        return NOT_ASKED_FOR
    if not hasattr(os, policy):
        return NOT_KNOWN
    try:
        os.sched_setscheduler(thread_id, getattr(os, policy), os.sched_param(priority))
    except (PermissionError, ProcessLookupError):  # the latter: the thread has just ended
        return NOT_PERMITTED
    return name


_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # malloc.h
_KEPT_BYTES = 64 << 20  # free at the end of a heap, before it is given back
_LARGEST_KEPT_BYTES = 32 << 20  # of one block; malloc allows no more


def keep_freed_memory() -> None:
    """Keep what this process frees from now on, up to 64 MB a heap; only glibc knows how.

    An image is larger than what glibc's malloc keeps by itself: it gives the memory back at once,
    and the next image of the same size gets new pages, which the kernel clears one by one. That
    takes longer than most of what is then done with an image.
    """
    set_option = getattr(ctypes.CDLL(None), "mallopt", None)
    if set_option is not None:
        set_option(_TRIM_THRESHOLD, _KEPT_BYTES)
        set_option(_MMAP_THRESHOLD, _LARGEST_KEPT_BYTES)
