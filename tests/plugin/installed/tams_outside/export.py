"""An export: how many ticks each log has."""

from collections.abc import Sequence
from pathlib import Path

from tams_app.export.options import ExportOptions
from tams_app.printing import Console
from tams_app.recording import read_log


def write(logs: Sequence[Path], out: Path | None, options: ExportOptions, console: Console) -> None:
    assert out is not None
    counts = [len(read_log(log).ticks) for log in logs]
    out.write_text(f"{options.task}: {counts}\n")
