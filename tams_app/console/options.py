"""Options that several commands take, each with one meaning, and what they lay over the file."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, get_args

import typer

from tams_app.config import Config, OperatorKind, load_config
from tams_app.config.whole import REMOVED
from tams_app.errors import ConfigError, TamsError
from tams_app.policy.allocation import STRATEGIES
from tams_app.policy.budget import BUDGETS

if TYPE_CHECKING:
    from tams_app.link.gateway_client import Endpoint

_FOXGLOVE, _ROS2 = "127.0.0.1:8765", "0"

CommandFunction: TypeAlias = Callable[..., None]
ConfigOption = Annotated[
    Path | None, typer.Option("--config", help="Configuration file; default config/tams.yaml.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON.")]
KeyOption = Annotated[
    Path | None,
    typer.Option("--key", help="This computer's key file; not needed on loopback."),
]


def network_names(ctx: typer.Context) -> list[str]:
    """Completions by the configuration's networks; where none fits, the shell offers files."""
    try:
        return list(load_config(ctx.params.get("config")).networks)
    except TamsError:  # it is named when the command runs
        return []


def _devices() -> list[str]:
    from hw.make_controller import DEVICES  # not for every command

    return ["auto", *DEVICES, "page", "sim"]


class Override:
    """An option that lays its value over a key of the configuration, and takes what that takes.

    A truth value is a flag that sets it. The bounds are the configuration's to check.
    """

    def __init__(
        self,
        key: str,
        help_text: str | None = None,
        words: Iterable[str] | None = None,
        default: str | None = None,
        bare: str = "",
        kind: Any = None,
        **how: Any,
    ) -> None:
        """Describe the option of a dotted `key`.

        Args:
            key: of the configuration.
            help_text: what --help says of it.
            words: what the shell offers as its value.
            default: laid over the key if it is not given; None: the key stays as in the file.
            bare: its value where it is given without one; "": it always needs one.
            kind: of its value; None: that of the key.
            how: further arguments of `typer.Option`.
        """
        self.key, self.default, self.bare = key, default, bare
        self._kind = kind or _kind_at(key)
        if words is not None:  # the length of a registry would search all distributions
            how["autocompletion"] = lambda: list(words)
        self._how: dict[str, Any] = {"help": help_text, **how}

    def parameter(self, name: str) -> inspect.Parameter:
        """The parameter of that name, for typer."""
        flag = (f"--{name.replace('_', '-')}",) if self._kind is bool else ()
        return inspect.Parameter(
            name,
            inspect.Parameter.KEYWORD_ONLY,
            default=False if flag else self.default,
            annotation=Annotated[self._kind, typer.Option(*flag, **self._how)],
        )


def _kind_at(key: str) -> Any:
    """The type of a key of the configuration: `bool`, `int` or `float`, and `str` for all else."""
    hint: Any = Config
    for part in key.split("."):
        hint = hint.model_fields[part].annotation
    return _kind_of(hint)


def _kind_of(hint: Any) -> Any:
    if hint in (bool, int, float):
        return hint
    kinds = map(_kind_of, get_args(hint))
    return next((kind for kind in kinds if kind is not str), str)


OPTIONS = {
    "sim": Override("rig.enabled", "Use the simulated arm and cameras, not the configured ones."),
    "strategy": Override(
        "strategy",
        "How views share the bitrate: equal, static, tams, tams+ or an installed one.",
        STRATEGIES,
    ),
    "preset": Override(
        "preset", "reference: the constants of the authors' nodes, over file and calibration."
    ),
    "network": Override(
        "network", "Emulate s1, s2, s3, none or a trace file.", autocompletion=network_names
    ),
    "budget": Override(
        "policy.budget.mode", "Source of the budget: feedback, sender or oracle.", BUDGETS
    ),
    "seconds": Override("seconds", "End after this many seconds."),
    "seed": Override("seed", "Seed of scene, noise and packet loss."),
    "fps": Override("video.fps", "Frames a second that each camera is asked for; 30 by default."),
    "headless": Override("headless", "Open no window."),
    "hand": Override(
        "controller.device",
        "What the operator holds: openvr, keyboard, page (a browser), sim or an installed one.",
        autocompletion=_devices,
    ),
    "operator": Override(
        "rig.operator.kind", "Simulated operator: seeing or scripted.", get_args(OperatorKind)
    ),
    "predict": Override(
        "view.predict",
        "Compensate for delay: eih (redraws the wrist camera's frames as they would look now), "
        "all (eih, and outlines the arm's current pose in the other views) or off.",
        ("eih", "all", "off"),
    ),
    "record_reference": Override(
        "recording.record_reference", "Also record the camera images without loss."
    ),
    "episodes": Override(
        "recording.episode_count",
        "Record episodes, kept or discarded by key; end when N are kept.",
        bare="0",  # any number
        metavar="[N]",
        min=0,
    ),
    "foxglove": Override(
        "recording.foxglove",
        f"Let Foxglove connect while the session runs; by default at {_FOXGLOVE}.",
        bare=_FOXGLOVE,
        metavar="[HOST:PORT]",
    ),
    "ros2": Override(
        "recording.ros2",
        f"Publish the session in ROS 2 while it runs; by default in domain {_ROS2}.",
        bare=_ROS2,
        metavar="[DOMAIN]",
    ),
    "out": Override("recording.directory", "Folder for the session folders.", kind=Path),
}


def overriding(
    order: str,
    others: Mapping[str, Override] | None = None,
    laid: Mapping[str, Any] | None = None,
) -> Callable[[CommandFunction], CommandFunction]:
    """Make a command of a function of `settings`, the configuration, and what it declares itself.

    order: all that the command takes, as its --help lists it. What the function does not declare
    itself is looked up in `others`, then in `OPTIONS`, and is laid over the file of --config, and
    `laid` over that. A function of `overrides` gets these in place of the configuration, by key:
    None if it was not given.
    """
    known = {**OPTIONS, **(others or {})}
    file = inspect.Parameter(
        "config", inspect.Parameter.KEYWORD_ONLY, default=None, annotation=ConfigOption
    )

    def decorated(function: CommandFunction) -> CommandFunction:
        declared = inspect.signature(function, eval_str=True).parameters
        takes_settings = "settings" in declared
        own = {"config": file, **declared} if takes_settings else {**declared}
        laid_over = {"settings" if takes_settings else "overrides"}
        assert {*declared} <= {*laid_over, *order.split()}, "an option that --help would not list"
        options = {name: known[name] for name in order.split() if name not in own}

        @wraps(function)
        def command(**given: Any) -> None:
            overrides = {one.key: _value(given.pop(name)) for name, one in options.items()}
            if overrides.get("recording.episode_count") is not None:
                overrides["recording.episodes"] = True
            if takes_settings:
                settings = load_config(given.pop("config"), {**overrides, **(laid or {})})
                function(settings=settings, **given)
            else:
                function(overrides=overrides, **given)

        parameters = [
            own[name].replace(kind=inspect.Parameter.KEYWORD_ONLY)
            if name in own
            else options[name].parameter(name)
            for name in order.split()
        ]
        command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        return command

    return decorated


def _value(given: Any) -> Any:
    """The value laid over a key: the text of a path, and nothing for a flag that is not set."""
    return str(given) if isinstance(given, Path) else None if given is False else given


def endpoint_of(
    option: str, given: str, key: Path | None, accepts_several: bool = False
) -> Endpoint:
    """HOST:PORT (IPv6: [HOST]:PORT) and the key; ConfigError unless they can be used together.

    `accepts_several`: on the robot's side the key may be a folder of keys.
    """
    from tams_app.link.addresses import addresses_of, is_loopback
    from tams_app.link.gateway_client import Endpoint
    from tams_app.link.keys import keys_of_robot, read_key
    from tams_app.telemetry.gate import Address

    at = Address.of(given, option, "192.168.1.20:7300")
    host, port = at.host, at.port
    try:
        _, addresses = addresses_of(host, port)
    except (OSError, UnicodeError) as error:
        raise ConfigError(f"{option}: {host} is not known: give a name or an address") from error
    if key is None and not all(map(is_loopback, addresses)):
        raise ConfigError(
            f"{option}: {host} can be reached from other computers, so --key is needed: "
            "make one on the robot's computer with: key new FILE"
        )
    if key is None:
        # what listens does so at what was judged, not what it is later; who calls judges it again
        return Endpoint(addresses[0][0] if accepts_several else host, port, None)
    # what is wrong with it is reported before anything is started
    if accepts_several:
        keys_of_robot(key)
    else:
        read_key(key)
    return Endpoint(host, port, key)


def with_values(arguments: list[str]) -> list[str]:
    """The command line with the values of options that are given without one.

    ConfigError for an option that there was.
    """
    words = [argument for argument in arguments[:2] if not argument.startswith("-")]
    for name in (argument.partition("=")[0] for argument in arguments if argument.startswith("--")):
        for before in (words, words[:1], []):
            if instead := REMOVED.get(" ".join([*before, name])):
                raise ConfigError(f"{name}: {instead}")
    bare = {f"--{name}": one.bare for name, one in OPTIONS.items() if one.bare}
    found: list[str] = []
    for argument, following in pairwise([*arguments, "-"]):
        found.append(argument)
        if argument in bare and following.startswith("-"):
            found.append(bare[argument])
    return found
