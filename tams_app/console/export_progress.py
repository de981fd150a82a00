"""The progress of an export, as a bar."""

from __future__ import annotations

from rich.progress import Progress

from tams_app.printing import Console


class ExportProgress(Progress):
    """A bar of the frames written; on no terminal the sentences alone."""

    def __init__(self, console: Console) -> None:
        super().__init__(console=console, transient=True, disable=not console.is_terminal)
        self._frames = self.add_task("frames", total=None)  # while the logs are read

    def notify(self, text: str) -> None:
        self.console.print(text, soft_wrap=True)

    def begin(self, frames: int) -> None:
        self.update(self._frames, total=frames)

    def frame(self) -> None:
        self.advance(self._frames)
