"""The base of all wizards: refusal first, then measuring, then the question and the file."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

from matplotlib.figure import Figure

from calibration.cli import CalibrationOptions
from calibration.store import Calibration, CalibrationSet
from calibration.ui import WizardUI
from tams_app.config import Config, load_config
from tams_app.errors import ConfigError, TamsError
from tams_app.report.plots import save_figure

FIGURE_SUFFIXES = (".png", ".jpg")

Options = TypeVar("Options", bound=CalibrationOptions)


class Wizard(ABC, Generic[Options]):
    """One run of a wizard, from its options to the exit code.

    A subclass says what makes no sense (`check`), what it measures (`measure`), how that looks
    (`drawn`), and what of it is worth keeping if it ends early (`partial`).
    """

    figure_beside: ClassVar[bool] = True  # whether the figure is drawn beside the file written
    overrides: dict[str, Any] | None = None  # dotted keys laid over the configuration
    config: Config
    store: CalibrationSet

    def __init__(self, ui: WizardUI, options: Options) -> None:
        self.ui, self.options = ui, options
        self.figure: Path | None = getattr(options, "figure", None)
        self.yes: bool = getattr(options, "yes", True)  # write it without asking
        self.simulated = options.sim  # whether anything simulated has a part in the result

    def run(self) -> int:
        """Calibrate.

        Returns:
            0 if the result was written or not wanted, 1 if there was no one to ask.

        Raises:
            ConfigError: Options or configuration make no sense; nothing was measured.
            TamsError: What was measured is no use, cannot be written, or is unfounded and no
                question was to be asked.
        """
        options = self.options
        if self.figure is not None:
            check_figure(self.figure)
        self.check()
        self.config = load_config(options.config, self.overrides)
        self.store = CalibrationSet(options.config, self.config)
        self.prepare()
        self.store.check_before(self.ui, self.yes, self.simulated)
        with self.ui:
            found = self._measured()
            if self.figure is not None and (drawn := self.drawn()) is not None:
                save_figure(drawn, self.figure)
                self.ui.print(f"Drawn: {self.figure}")
            if found is None:
                return 0
            attended = self.ui.attended
            beside = self.drawn() if self.figure_beside else None
            accepts = getattr(options, "accept_unfounded", False)
            written = self.store.propose(self.ui, found, self.yes, beside, accepts)
            return 0 if written is not None or attended else 1

    @abstractmethod
    def check(self) -> None:
        """ConfigError for options that make no sense or could only fail after measuring.

        Sets `overrides` and `simulated` where the options ask for others.
        """

    @abstractmethod
    def measure(self) -> Calibration | None:
        """The whole conversation; None if there is nothing to write."""

    def prepare(self) -> None:
        """ConfigError for what does not go with the configuration; nothing was printed yet."""

    def drawn(self) -> Figure | None:
        """A figure of what was found; None if there is nothing to show."""
        return None

    def partial(self) -> Calibration | None:
        """What is worth keeping when `measure` is interrupted."""
        return None

    def require_person(self) -> None:
        """ConfigError if there is no person to do what is asked."""
        if not self.ui.attended:
            raise ConfigError("there is no terminal: start it from one, or give --sim")

    def _measured(self) -> Calibration | None:
        try:
            return self.measure()
        except (KeyboardInterrupt, TamsError) as error:
            if (self.ui.attended or self.yes) and (part := self.partial()) is not None:
                self.ui.print(f"\nEnded early: {str(error) or 'Ctrl-C'}")
                self.store.keep(self.ui, part)
            raise


def check_figure(path: Path) -> None:
    """ConfigError if no figure can be drawn there."""
    if path.suffix.lower() not in FIGURE_SUFFIXES:
        raise ConfigError(f"--figure {path}: is drawn to {' or '.join(FIGURE_SUFFIXES)}")
    if not path.parent.is_dir():
        raise ConfigError(f"--figure {path}: there is no folder {path.parent}")
    if path.is_dir():
        raise ConfigError(f"--figure {path}: is a folder, not a file")
