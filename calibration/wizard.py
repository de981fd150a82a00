"""The run of every wizard, from its options to the file."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from calibration.kit import WizardUI
from calibration.options import CalibrationOptions
from calibration.store import Calibration, CalibrationSet
from tams_app.config import Config, load_config
from tams_app.errors import ConfigError, TamsError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Options = TypeVar("Options", bound=CalibrationOptions)


class Wizard(ABC, Generic[Options]):
    """One run of a wizard, from its options to the exit code.

    A subclass says what makes no sense (`check`), what it measures (`measure`), how that looks
    (`drawn`), and what of it is worth keeping if it ends early (`partial`).
    """

    overrides: dict[str, Any] | None = None  # dotted keys laid over the configuration
    config: Config
    store: CalibrationSet

    def __init__(self, ui: WizardUI, options: Options) -> None:
        self.ui, self.options = ui, options
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
        self.check()
        self.config = load_config(options.config, self.overrides)
        self.store = CalibrationSet(options.config, self.config)
        self.prepare()
        self.store.check_before(self.ui, self.yes, self.simulated)
        with self.ui:
            found = self._measured()
            if found is None:
                return 0
            attended = self.ui.attended
            accepts = getattr(options, "accept_unfounded", None)
            written = self.store.propose(self.ui, found, self.yes, self.drawn, accepts)
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
        """A figure of what was found, to lie beside the file; None if there is nothing to show."""
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
