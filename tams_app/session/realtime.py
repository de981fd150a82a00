"""Real-time priority for a thread, where the system allows it."""

from __future__ import annotations

import os


def use_fifo(priority: int) -> str:
    """Put the calling thread under SCHED_FIFO at `priority`; 0 leaves it alone.

    Returns "fifo", or why not ("other: ..."): the session logs it, TAMS runs without it too.
    """
    if priority == 0:
        return "other: not asked for"
    if not hasattr(os, "sched_setscheduler"):
        return "other: this system has no SCHED_FIFO"
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        return "other: not permitted (see run_tams.py doctor)"
    return "fifo"
