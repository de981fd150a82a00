"""The same uplink conditions on real hardware: `tc` on the interface the video leaves by.

netem gives delay, jitter and loss, its child tbf the rate and the queue in bytes. Where the
kernel has no netem, the rate alone can be set. What differs from `link.Link`: packets are lost
and delayed before the bottleneck instead of behind it, and tbf counts the 14 bytes of an Ethernet
header too (1 % of a full packet). Everything that leaves by the interface is shaped, not video
alone: the arm must be reached by another one.
"""

from __future__ import annotations

import math
import re
import shlex
import subprocess
from collections.abc import Callable
from pathlib import Path

from tams_app.config import Config, Network
from tams_app.errors import ConfigError, SetupError, TamsError, not_one_of
from tams_app.video.core.link import good_to_bad
from tams_app.video.live.networks import resolve_network

Runner = Callable[[list[str]], "subprocess.CompletedProcess[str]"]

ACTIONS = ("print", "apply", "rate", "remove", "show")
_TIMEOUT_S = 10
_INTERFACE_NAME = re.compile(r"[^/\s;]{1,15}")  # the kernel's rule, and nothing a shell would split
_SMALLEST_BURST_BYTES = 3100  # two full Ethernet frames
_SMALLEST_PACKET_BYTES = 256  # mean size at which netem's packet limit must still hold
# With a rate, netem counts each packet's delay from the one before, so jitter cannot reorder;
# this one is too fast to be felt (1 µs a packet).
_ORDERING_RATE = "10gbit"


def commands(network: Network, interface: str, rate_only: bool = False) -> list[list[str]]:
    """The `tc` calls that give `interface` the conditions of `network`; ConfigError if none can.

    `rate_only`: the rate and its queue alone, for a kernel without netem.
    """
    _refuse_loopback(interface)
    if network.trace is not None:
        raise ConfigError("tc cannot follow a capacity trace; name a network with a constant rate")
    netem = [] if rate_only else _netem(network)
    tbf = _tbf(network)
    replace = ["tc", "qdisc", "replace", "dev", interface]
    if netem and tbf:
        return [
            [*replace, "root", "handle", "1:", *netem],
            [*replace, "parent", "1:1", "handle", "2:", *tbf],
        ]
    if netem or tbf:
        return [[*replace, "root", "handle", "1:", *netem, *tbf]]
    what = "rate" if rate_only else "delay, loss or rate"
    raise ConfigError(f"this network has no {what} to set; use remove instead")


def remove_command(interface: str) -> list[str]:
    """The call that gives `interface` its own queue back."""
    _refuse_loopback(interface)
    return ["tc", "qdisc", "del", "dev", interface, "root"]


def _netem(network: Network) -> list[str]:
    options: list[str] = []
    if network.latency_ms or network.jitter_ms:
        options += ["delay", f"{network.latency_ms:g}ms"]
        if network.jitter_ms:
            options += [f"{network.jitter_ms:g}ms"]
    if network.loss_burst > 1 and network.loss:
        fail = good_to_bad(network.loss, network.loss_burst)
        options += ["loss", "gemodel", f"{100 * fail:.6g}%", f"{100 / network.loss_burst:.6g}%"]
    elif network.loss:
        options += ["loss", f"{100 * network.loss:.6g}%"]
    if not options:
        return []
    # All that is in flight and queued must fit netem's own limit, which on some kernels counts
    # what waits in the child too.
    rate_kbps = network.rate_kbps or 100_000.0
    in_flight_bytes = 2 * (network.latency_ms + network.jitter_ms) * rate_kbps / 8
    held_bytes = in_flight_bytes + _queue_bytes(network)
    packets = max(1000, math.ceil(held_bytes / _SMALLEST_PACKET_BYTES))
    return ["netem", "limit", str(packets), *options, "rate", _ORDERING_RATE]


def _tbf(network: Network) -> list[str]:
    if network.rate_kbps is None:
        return []
    burst_bytes = max(_SMALLEST_BURST_BYTES, network.rate_kbps / 8)  # 1 ms
    rate, queue_bytes = f"{round(network.rate_kbps * 1000)}bit", _queue_bytes(network)
    return ["tbf", "rate", rate, "burst", f"{burst_bytes:.0f}", "limit", f"{queue_bytes:.0f}"]


def _queue_bytes(network: Network) -> float:
    """The size of the rate's queue; 0 without a rate."""
    if network.rate_kbps is None:
        return 0.0
    return max(network.queue_ms * network.rate_kbps / 8, network.queue_min_bytes)


def _refuse_wrong_name(interface: str) -> None:
    if not _INTERFACE_NAME.fullmatch(interface):
        raise ConfigError(
            f"{interface!r} is no interface name: 1 to 15 characters, no slash, semicolon or "
            "white space; `ip link` lists those there are"
        )


def _refuse_loopback(interface: str) -> None:
    _refuse_wrong_name(interface)
    flags = Path("/sys/class/net", interface, "flags")
    loopback = interface == "lo" or (flags.is_file() and int(flags.read_text(), 16) & 0x8)
    if loopback:
        raise ConfigError(
            f"{interface} is a loopback interface, which the parts of TAMS talk over; "
            "name the interface the video leaves by"
        )


def run_tc(command: list[str]) -> subprocess.CompletedProcess[str]:
    """Run one command; SetupError if it is not installed or does not end."""
    try:
        return subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=_TIMEOUT_S
        )
    except FileNotFoundError as error:
        raise SetupError("tc is missing; install the package iproute2") from error
    except subprocess.TimeoutExpired as error:
        raise SetupError(f"`{shlex.join(command)}` did not end within {_TIMEOUT_S} s") from error


def apply(set_up: list[list[str]], interface: str, runner: Runner = run_tc) -> None:
    """Run `set_up` in order; on a failure what was set is removed and SetupError says why."""
    for done, command in enumerate(set_up):
        result = runner(command)
        if result.returncode != 0:
            if done:
                runner(remove_command(interface))
            raise _failure(command, result.stderr)


def remove(interface: str, runner: Runner = run_tc) -> bool:
    """Take the set-up away; False if there was none. SetupError if that is not possible."""
    result = runner(command := remove_command(interface))
    if "handle of zero" in result.stderr or "No such file or directory" in result.stderr:
        return False
    if result.returncode != 0:
        raise _failure(command, result.stderr)
    return True


def show(interface: str, runner: Runner = run_tc) -> str:
    """The disciplines on `interface` now, as `tc` prints them."""
    _refuse_wrong_name(interface)
    result = runner(command := ["tc", "qdisc", "show", "dev", interface])
    if result.returncode != 0:
        raise _failure(command, result.stderr)
    return result.stdout.strip()


def _failure(command: list[str], stderr: str) -> TamsError:
    interface = command[command.index("dev") + 1]
    reason = " ".join(stderr.split())
    if "Operation not permitted" in reason:
        return SetupError(f"changing {interface} needs root; run the command again with sudo")
    if "Cannot find device" in reason:
        return ConfigError(f"there is no interface {interface}; `ip link` lists those there are")
    kind_missing = "qdisc kind is unknown" in reason or "No such file or directory" in reason
    if "netem" in command and kind_missing:
        return SetupError(
            "this kernel has no netem, so delay, jitter and loss cannot be set; load it "
            "(modprobe sch_netem), or set the rate alone with --action rate"
        )
    return SetupError(f"`{shlex.join(command)}` failed: {reason}")


def run_network(
    config: Config, name: str, interface: str, action: str, runner: Runner = run_tc
) -> list[str]:
    """The command `run_tams.py network`, and the lines that it prints; `action` is one of ACTIONS.

    Only apply, rate (the rate alone) and remove change anything. ConfigError, SetupError.
    """
    if action not in ACTIONS:
        raise ConfigError(f"--action: {not_one_of(action, ACTIONS)}")
    network = resolve_network(config, name)
    if action == "show":
        return [show(interface, runner)]
    if action == "remove":
        removed = remove(interface, runner)
        return [f"{interface} is as before" if removed else f"nothing was set on {interface}"]
    if action == "print":
        return [
            f"# shapes everything that leaves by {interface}, not video alone; needs root",
            *map(shlex.join, commands(network, interface)),
            "# and to take it away",
            shlex.join(remove_command(interface)),
        ]
    apply(commands(network, interface, rate_only=action == "rate"), interface, runner)
    part = "the rate of " if action == "rate" else ""
    return [f"{interface} now has {part}network {name}; --action remove takes it away"]
