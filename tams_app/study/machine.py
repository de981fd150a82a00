"""What a result may depend on; written last, so that it also marks a trial that ran to its end."""

from __future__ import annotations

import json
import platform
from pathlib import Path

MACHINE_NAME = "machine.json"


def mark_ended(folder: Path) -> None:
    """Write machine.json into a trial's folder, after everything else."""
    text = json.dumps(machine(), indent=1) + "\n"
    (folder / MACHINE_NAME).write_text(text, encoding="utf-8")


def machine() -> dict[str, str]:
    """What a result may depend on: processor, system, Python."""
    return {
        "processor": _processor(),
        "architecture": platform.machine(),
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.processor()
