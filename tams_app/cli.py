"""The command line: commands and options only.

Packages that take long to import are imported by the command that needs them, so that `--help` and
the small tools answer at once.
"""

from __future__ import annotations

import json
import math
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer.exceptions import TyperException

from calibration.cli import app as calibrate
from tams_app import __version__
from tams_app.config import Config, load_config
from tams_app.console.logs_cli import add_logs
from tams_app.console.options import (
    ArmOption,
    BudgetOption,
    DryRunOption,
    FoxgloveOption,
    FpsOption,
    HandOption,
    HeadlessOption,
    JsonOption,
    KeyOption,
    NetworkOption,
    OperatorOption,
    OutOption,
    ReferenceOption,
    Ros2Option,
    SecondsOption,
    SeedOption,
    SimOption,
    StrategyOption,
    arm_overrides,
    check_arm_at_once,
    network_names,
    with_values,
)
from tams_app.console.two_sided_cli import add_two_sided
from tams_app.errors import ConfigError, SetupError, TamsError
from tams_app.policy.allocation import make_strategy
from tams_app.study.cli import ConfigOption, study_app

if TYPE_CHECKING:
    from tams_app.study.runner import TrialRunner

app = typer.Typer(
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    epilog="Exit codes: 0 done; 1 the job failed; 2 wrong use, configuration or input; "
    "130 ended by Ctrl-C or a signal.",
)

app.add_typer(calibrate, name="calibrate")

MAX_KBPS = 1e9


def _kbps(text: str) -> float:
    """The argument of an option that takes a rate."""
    try:
        rate = float(text)
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not a number") from None
    if not 0 <= rate <= MAX_KBPS:
        name = "NaN" if math.isnan(rate) else "infinity" if math.isinf(rate) else text
        raise typer.BadParameter(f"{name} is not a rate: give 0 to {MAX_KBPS:.0f} kbit/s")
    return rate


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
    arguments = with_values(arguments)
    if not arguments or (arguments[0].startswith("-") and arguments[0] not in _GLOBAL_OPTIONS):
        arguments.insert(0, "run")
    try:
        code = app(arguments, prog_name=called_as, standalone_mode=False) or 0
    except TamsError as error:
        if debug:
            raise
        typer.echo(f"tams: {error}", err=True)
        return error.exit_code
    except OSError as error:  # what files do is handled where they are used
        typer.echo(f"tams: standard output cannot be written: {error.strerror}", err=True)
        return 1
    except TyperException as error:
        typer.echo(f"tams: {error.format_message()} (see {called_as} --help)", err=True)
        return 2
    if code == _CTRL_C:
        raise KeyboardInterrupt
    return int(code)


_GLOBAL_OPTIONS = ("-h", "--help", "--version", "--install-completion", "--show-completion")
_CTRL_C = 130  # 128 + SIGINT, as shells have it; also what typer makes of a KeyboardInterrupt


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"TAMS {__version__}")
        raise typer.Exit


@app.callback()
def _tams(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="And exit.")
    ] = False,
) -> None:
    """Task-aware multi-view adaptive streaming for wireless telerobotic manipulation.

    Every command takes --debug: a traceback instead of one sentence.
    """


@app.command()
def run(
    config: ConfigOption = None,
    sim: SimOption = False,
    strategy: StrategyOption = None,
    network: NetworkOption = None,
    budget: BudgetOption = None,
    seconds: SecondsOption = None,
    seed: SeedOption = None,
    fps: FpsOption = None,
    headless: HeadlessOption = False,
    hand: HandOption = None,
    operator: OperatorOption = None,
    arm: ArmOption = False,
    dry_run: DryRunOption = False,
    record_reference: ReferenceOption = False,
    foxglove: FoxgloveOption = None,
    ros2: Ros2Option = None,
    out: OutOption = None,
) -> None:
    """Teleoperate: on the simulated rig, one pick-and-place by a simulated operator."""
    overrides = arm_overrides(
        sim=sim,
        strategy=strategy,
        network=network,
        budget=budget,
        seconds=seconds,
        seed=seed,
        fps=fps,
        record_reference=record_reference,
        foxglove=foxglove,
        ros2=ros2,
        out=out,
    )
    overrides |= {
        "headless": True if headless else None,
        "controller.device": hand,
        "rig.operator.kind": operator,
    }
    settings = load_config(config, overrides)
    check_arm_at_once(arm, settings)
    typer.echo("starting: arm, cameras, video …")  # before what takes long to import
    from tams_app.console.app import run_session

    raise typer.Exit(run_session(settings, arm_at_once=arm, dry_run=dry_run))


add_two_sided(app)


@app.command()
def home(config: ConfigOption = None) -> None:
    """Move the arm slowly to its ready pose, only while Enter is held."""
    from tams_app.console.home import run_home

    raise typer.Exit(run_home(load_config(config)))


@app.command()
def doctor(
    config: ConfigOption = None,
    devices: Annotated[
        bool, typer.Option("--devices", help="List the arms, controllers and cameras found.")
    ] = False,
    speed: Annotated[
        bool,
        typer.Option("--speed", help="Measure which frame rate this machine holds, on the rig."),
    ] = False,
    link: Annotated[
        str | None,
        typer.Option(metavar="HOST:PORT", help="Measure the network to a `robot` that runs there."),
    ] = None,
    key: KeyOption = None,
    as_json: JsonOption = False,
) -> None:
    """Check this machine, and print the fix for each thing that is missing."""
    asked = {"--devices": devices, "--speed": speed, "--link": link is not None}
    chosen = [option for option, given in asked.items() if given]
    if len(chosen) > 1:
        raise ConfigError(f"{' and '.join(chosen)}: one at a time")
    if key is not None and link is None:
        raise ConfigError("--key: is for --link; leave it out here")
    if link is not None:
        if config is not None:
            raise ConfigError("--config: --link needs none; leave it out")
        from tams_app.console.link_check import run_link_check
        from tams_app.console.two_sided import endpoint_of

        raise typer.Exit(run_link_check(endpoint_of("--link", link, key), as_json))
    settings = load_config(config, {"rig.enabled": True if speed else None})
    if speed:
        from tams_app.console.speed import run_speed

        raise typer.Exit(run_speed(settings, as_json))
    if devices:
        from tams_app.console.doctor import show_devices

        raise typer.Exit(show_devices(settings, as_json))
    from tams_app.console.checks import CHECKS
    from tams_app.console.doctor import run_doctor

    raise typer.Exit(run_doctor(settings, CHECKS, as_json))


add_logs(app)


def _actions() -> list[str]:
    from tams_app.video.netem import ACTIONS

    return list(ACTIONS)


@app.command()
def network(
    name: Annotated[
        str,
        typer.Argument(
            help="A condition of the configuration: s1, s2, s3.", autocompletion=network_names
        ),
    ],
    interface: Annotated[str, typer.Option(help="The network interface to shape.")],
    action: Annotated[
        str,
        typer.Option(
            help="print, apply, rate (apply the rate only), show or remove.",
            autocompletion=_actions,
        ),
    ] = "print",
    config: ConfigOption = None,
) -> None:
    """Emulate a network condition on an interface with `tc`.

    With `robot` the video crosses that interface. With `run` it stays on loopback, and
    `run --network` emulates its link.
    """
    from tams_app.video.netem import run_network

    run_network(load_config(config), name, interface, action, typer.echo)


@app.command()
def phases(
    file: Annotated[Path, typer.Argument(metavar="FILE.csv")],
    out: Annotated[Path | None, typer.Option(help="Default: standard output.")] = None,
    no_smoothing: Annotated[
        bool, typer.Option("--no-smoothing", help="The speeds are smoothed already.")
    ] = False,
    v_eps_mm_s: Annotated[float | None, typer.Option()] = None,
    vz_min_mm_s: Annotated[float | None, typer.Option()] = None,
    align_dwell_s: Annotated[float | None, typer.Option()] = None,
    pre_release_dwell_s: Annotated[float | None, typer.Option()] = None,
    config: ConfigOption = None,
) -> None:
    """Algorithm 1 over a table: t_s, vx_mm_s, vy_mm_s, vz_mm_s, gripper (0 open, 1 closed)."""
    from tams_app.policy.offline import label_phases
    from tams_app.policy.phases import PhaseParameters

    settings = load_config(
        config,
        {
            "policy.phases.v_eps_mm_s": v_eps_mm_s,
            "policy.phases.vz_min_mm_s": vz_min_mm_s,
            "policy.phases.align_dwell_s": align_dwell_s,
            "policy.phases.pre_release_dwell_s": pre_release_dwell_s,
        },
    ).policy.phases
    if out is not None and out.exists() and file.exists() and out.samefile(file):
        raise ConfigError(f"--out: {out} is the table that is read: give another file")
    smoothing_s = None if no_smoothing else settings.smoothing_ms / 1000
    labelled = label_phases(_read(file), str(file), PhaseParameters.of(settings), smoothing_s)
    if out is None:
        typer.echo(labelled, nl=False)
    else:
        _write(out, labelled)


def _phases() -> list[str]:
    from tams_app.records import Phase

    return [phase.replace("_", "-").capitalize() for phase in Phase]


@app.command()
def allocate(
    phase: Annotated[
        str,
        typer.Option(
            help="Reach, Align, Grasp, Transport, Pre-release or Release.",
            autocompletion=_phases,
        ),
    ],
    budget_kbps: Annotated[
        float,
        typer.Option(parser=_kbps, metavar="KBPS", help="B, after the safety factor."),
    ],
    floor_kbps: Annotated[
        float | None,
        typer.Option(parser=_kbps, metavar="KBPS", help="What each view gets at least."),
    ] = None,
    strategy: StrategyOption = None,
    as_json: JsonOption = False,
    config: ConfigOption = None,
) -> None:
    """The targets that a strategy gives each view while a phase begins."""
    from tams_app.records import Phase

    settings = load_config(config, {"policy.allocation.floor_kbps": floor_kbps})
    name = phase.strip().upper().replace("-", "_").replace(" ", "_")
    if name not in Phase.__members__:
        raise ConfigError(f"--phase: {phase!r} is none of {', '.join(Phase.__members__)}")
    chosen = make_strategy(strategy or settings.strategy, settings.policy)
    floor = settings.policy.allocation.floor_kbps
    targets = chosen.targets(Phase[name], budget_kbps)
    if budget_kbps < len(targets) * floor:
        typer.echo(
            f"tams: note: {budget_kbps:g} kbit/s are less than the floor of {floor:g} kbit/s for "
            f"each of {len(targets)} views: the floor is not kept",
            err=True,
        )
    if as_json:
        typer.echo(json.dumps(targets))
    else:
        for view, kbps in targets.items():
            typer.echo(f"{view}  {kbps} kbit/s")


def _simulated_trials(settings: Config) -> TrialRunner:
    if find_spec("mujoco") is None:
        raise SetupError("simulated trials need MuJoCo: pip install mujoco")
    from tams_app.session.virtual import SimulatedTrialRunner

    return SimulatedTrialRunner(settings)


def _trials_with_people(settings: Config) -> TrialRunner:
    from tams_app.console.trial import LiveTrialRunner

    return LiveTrialRunner(settings)


app.add_typer(study_app(_simulated_trials, _trials_with_people), name="study")


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is not UTF-8 text") from error


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from error
