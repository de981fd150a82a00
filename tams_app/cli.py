"""The command line: commands and options only.

Packages that take long to import are imported by the command that needs them, so that `--help` and
the small tools answer at once.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.exceptions import TyperException

from calibration.cli import app as calibrate
from tams_app import __version__
from tams_app.config import load_config
from tams_app.console import options
from tams_app.console.explain import config
from tams_app.console.export_cli import export
from tams_app.console.logs_cli import log_app, replay, report
from tams_app.console.phases import phases
from tams_app.console.session_cli import key_app, operate, robot, run
from tams_app.console.tools_cli import allocate, network
from tams_app.errors import ConfigError, TamsError

app = typer.Typer(
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    epilog="Exit codes: 0 done; 1 the job failed; 2 wrong use, configuration or input; "
    "130 ended by Ctrl-C or a signal.",
)

app.add_typer(calibrate, name="calibrate")


def main() -> None:
    """Run the command line; without a command it is `run`. Errors are one sentence on stderr.

    Ends the process with 0 (done), 1 (the job failed), 2 (wrong use, configuration or input) or
    130 (ended by Ctrl-C or a signal).
    """
    try:
        code = _main(sys.argv[1:], Path(sys.argv[0]).name)
    except KeyboardInterrupt:
        typer.echo("tams: interrupted", err=True)
        code = _CTRL_C
    sys.exit(code)


def _main(arguments: list[str], called_as: str = "run_tams.py") -> int:
    debug = "--debug" in arguments
    arguments = [argument for argument in arguments if argument != "--debug"]
    try:
        arguments = options.with_values(arguments)
        if not arguments or (arguments[0].startswith("-") and arguments[0] not in _GLOBAL_OPTIONS):
            if not any(name.endswith("_COMPLETE") for name in os.environ):  # no shell's completion
                typer.echo(f"no command given, so this is `{called_as} run`; see also --help")
            arguments.insert(0, "run")
        code = app(arguments, prog_name=called_as, standalone_mode=False) or 0
    except TamsError as error:
        if debug:
            raise
        _show_error(str(error))
        return error.exit_code
    except OSError as error:  # what files do is handled where they are used
        typer.echo(f"tams: standard output cannot be written: {error.strerror}", err=True)
        with suppress(OSError):  # or Python tries to write the rest at its end, and exits with 120
            sys.stdout.close()
        return 1
    except TyperException as error:
        context = getattr(error, "ctx", None)
        where = context.command_path if context else called_as
        wrong = error.format_message().replace("Input should be", "must be")
        _show_error(f"{wrong} (see {where} --help)")
        return 2
    if code == _CTRL_C:
        raise KeyboardInterrupt
    return int(code)


def _show_error(sentence: str) -> None:
    from tams_app.faces.terminal.output import unblocked_output
    from tams_app.printing import Console

    with unblocked_output():
        Console(stderr=True).print(f"tams: {sentence}", soft_wrap=True)


_GLOBAL_OPTIONS = ("-h", "--help", "--version", "--install-completion", "--show-completion")
_CTRL_C = 130  # 128 + SIGINT, as shells have it; also what typer makes of a KeyboardInterrupt


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"TAMS {__version__}")
        raise typer.Exit


@app.callback()
def _tams(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Task-aware multi-view adaptive streaming for wireless telerobotic manipulation.

    Every command takes --debug: a traceback instead of one sentence.
    """


for _command in (run, robot, operate):
    app.command()(_command)


@app.command()
@options.overriding("file model host hand side camera")
def init(
    overrides: dict[str, Any],
    file: Annotated[Path, typer.Argument(metavar="[FILE]")] = Path("YOUR.yaml"),
    model: Annotated[str | None, typer.Option(help="The kind of arm, such as lite6.")] = None,
    host: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Address of the control box.")
    ] = None,
    side: Annotated[
        str | None, typer.Option(help="The hand that holds a tracked controller: right or left.")
    ] = None,
    camera: Annotated[
        list[str] | None,
        typer.Option(metavar="VIEW=SERIAL_OR_PATH", help="Camera of a view; repeat for each view."),
    ] = None,
) -> None:
    """Create a configuration for your arm, cameras and controller."""
    from calibration.first_file import Answers, write_first_file
    from calibration.kit import WizardUI

    hand = overrides["controller.device"]
    with WizardUI() as ui:
        write_first_file(ui, file, Answers(model, host, hand, side, tuple(camera or ())))


@app.command()
def home(config: options.ConfigOption = None) -> None:
    """Move the arm slowly to its ready pose while Enter is held."""
    from tams_app.console.home import run_home

    raise typer.Exit(run_home(load_config(config)))


@app.command()
def doctor(
    config: options.ConfigOption = None,
    devices: Annotated[
        bool, typer.Option("--devices", help="List the arms, controllers and cameras found.")
    ] = False,
    link: Annotated[
        str | None,
        typer.Option(metavar="HOST:PORT", help="Measure the network to a `robot` that runs there."),
    ] = None,
    key: options.KeyOption = None,
    as_json: options.JsonOption = False,
) -> None:
    """Check this machine, and say how to fix what is missing."""
    if devices and link is not None:
        raise ConfigError("--devices and --link: one at a time")
    if key is not None and link is None:
        raise ConfigError("--key: is for --link; leave it out here")
    if link is not None:
        if config is not None:
            raise ConfigError("--config: --link needs none; leave it out")
        from tams_app.console.link_check import run_link_check

        run_link_check(options.endpoint_of("--link", link, key), as_json)
        return
    settings = load_config(config)
    if devices:
        from tams_app.console.devices import show_devices

        show_devices(settings, as_json)
        return
    from tams_app.console.doctor import CHECKS, marked_keys, run_doctor

    checks = CHECKS if config is None else (*CHECKS, marked_keys(config))
    raise typer.Exit(run_doctor(settings, checks, as_json))


for _command in (report, replay, export, config, network, phases, allocate):
    app.command()(_command)
app.add_typer(key_app, name="key")
app.add_typer(log_app, name="log")
# the laboratory: nothing of the product imports it
app.add_typer(import_module("tams_app.study.cli").app, name="study")
