"""Network conditions on a real interface: the commands, the errors, and the rate for real."""

import os
import shutil
import subprocess
import sys

import pytest

from tams_app.config import Network, load_config
from tams_app.errors import ConfigError, SetupError
from tams_app.video.live import netem

pytestmark = pytest.mark.waiting

S2 = load_config().networks["s2"]
TC_THERE = shutil.which("tc") is not None


def joined(commands):
    return [" ".join(command) for command in commands]


def test_a_condition_is_netem_with_a_byte_limited_rate_below_it():
    assert joined(netem.commands(S2, "eth7")) == [
        "tc qdisc replace dev eth7 root handle 1: "
        "netem limit 1000 delay 40ms 8ms loss 0.3% rate 10gbit",
        "tc qdisc replace dev eth7 parent 1:1 handle 2: "
        "tbf rate 6000000bit burst 3100 limit 112500",
    ]


def test_bursts_become_a_gilbert_elliott_chain_and_a_small_queue_keeps_its_least_size():
    (command,) = joined(netem.commands(Network(loss=0.01, loss_burst=4.0), "eth7"))
    assert "loss gemodel 0.252525% 25%" in command
    (command,) = joined(netem.commands(Network(rate_kbps=1000), "eth7"))
    assert command.endswith("root handle 1: tbf rate 1000000bit burst 3100 limit 30000")


@pytest.mark.parametrize(("latency_ms", "queue_ms"), [(500, 150), (1, 2000)])
def test_netems_own_limit_holds_what_is_under_way_and_the_queue_of_its_child(latency_ms, queue_ms):
    network = Network(latency_ms=latency_ms, rate_kbps=100_000, queue_ms=queue_ms)
    packets, queue_bytes = (
        int(command[command.index("limit") + 1]) for command in netem.commands(network, "eth7")
    )
    assert packets * 256 >= queue_bytes + latency_ms * 100_000 / 8


def test_the_rate_alone_can_be_asked_for():
    assert joined(netem.commands(S2, "eth7", rate_only=True)) == [
        "tc qdisc replace dev eth7 root handle 1: tbf rate 6000000bit burst 3100 limit 112500"
    ]


@pytest.mark.parametrize("make", [netem.commands, lambda network, name: netem.remove_command(name)])
def test_loopback_is_refused(make):
    with pytest.raises(ConfigError, match="lo is a loopback interface"):
        make(S2, "lo")


@pytest.mark.parametrize("action", ["print", "apply", "rate", "remove", "show"])
@pytest.mark.parametrize(
    "name", ["", "a;b", "../../../tmp", "eth7\n", "a\nb", "a b", "a\tb", "x" * 16]
)
def test_what_can_be_no_interface_is_refused_before_anything_is_said_or_run(action, name):
    run, ran = answering()
    with pytest.raises(ConfigError, match="is no interface name: 1 to 15 characters"):
        netem.run_network(load_config(), "s2", name, action, run)
    assert ran == []


def test_what_tc_cannot_do_is_refused_in_a_sentence():
    with pytest.raises(ConfigError, match="cannot follow a capacity trace"):
        netem.commands(Network(trace="x.csv"), "eth7")
    with pytest.raises(ConfigError, match="no delay, loss or rate"):
        netem.commands(Network(), "eth7")
    with pytest.raises(ConfigError, match="no rate to set"):
        netem.commands(Network(latency_ms=5), "eth7", rate_only=True)
    with pytest.raises(ConfigError, match="is not one of print, apply, rate, remove, show"):
        netem.run_network(load_config(), "s2", "eth7", "destroy")


def test_printing_runs_nothing_also_for_an_interface_that_is_not_there_yet():
    run, ran = answering()
    said = netem.run_network(load_config(), "s3", "x" * 15, "print", run)
    assert [line.split()[0] for line in said] == ["#", "tc", "tc", "#", "tc"]
    assert f"everything that leaves by {'x' * 15}" in said[0]
    with pytest.raises(ConfigError, match="loopback"):
        netem.run_network(load_config(), "s2", "lo", "print", run)
    assert ran == []


def answering(*results):
    """A runner that gives these (exit code, error text) in turn and keeps the commands."""
    answers, ran = list(results), []

    def run(command):
        ran.append(" ".join(command))
        code, stderr = answers.pop(0)
        return subprocess.CompletedProcess(command, code, "", stderr)

    return run, ran


def test_a_half_done_set_up_is_taken_back():
    run, ran = answering((0, ""), (2, "Error: something else.\n"), (0, ""))
    with pytest.raises(SetupError, match=r"`tc .* tbf .*` failed: Error: something else"):
        netem.apply(netem.commands(S2, "eth7"), "eth7", run)
    assert ran[-1] == "tc qdisc del dev eth7 root"


def test_a_kernel_without_netem_is_told_with_the_way_out():
    run, ran = answering((2, "Error: Specified qdisc kind is unknown.\n"))
    with pytest.raises(SetupError, match=r"has no netem.*--action rate"):
        netem.apply(netem.commands(S2, "eth7"), "eth7", run)
    assert len(ran) == 1


def test_a_missing_tc_names_its_package():
    with pytest.raises(SetupError, match="install the package iproute2"):
        netem.run_tc(["tc-which-is-not-there"])


@pytest.mark.skipif(not TC_THERE, reason="tc is not installed")
def test_an_interface_that_is_not_there_is_said_to_be_missing():
    with pytest.raises(ConfigError, match=r"no interface nope0; `ip link`"):
        netem.show("nope0")


# --- for real, in a network namespace -----------------------------------------------------------


def ip(*words):
    return subprocess.run(["ip", *words], capture_output=True, text=True, timeout=10, check=False)


@pytest.fixture
def inside():
    """Runs a command in a network namespace of its own, which has the interface va."""
    if sys.platform != "linux" or os.geteuid() != 0 or not TC_THERE or not shutil.which("ip"):
        pytest.skip("needs Linux, root, ip and tc")
    space = f"tams-{os.getpid()}"
    if ip("netns", "add", space).returncode != 0:
        pytest.skip("network namespaces are not permitted here")
    try:
        for step in ("add va type veth peer name vb", "set va up"):
            if (result := ip("-n", space, "link", *step.split())).returncode != 0:
                pytest.skip(f"ip link {step}: {result.stderr.strip()}")
        yield lambda command: ip("netns", "exec", space, *command)
    finally:
        ip("netns", "del", space)


def test_the_rate_that_was_asked_for_is_set_and_taken_away(inside):
    netem.run_network(load_config(), "s2", "va", "rate", inside)
    assert "rate 6Mbit" in netem.show("va", inside)
    assert netem.remove("va", inside)
    assert "tbf" not in netem.show("va", inside)
    assert not netem.remove("va", inside)


def test_a_condition_is_set_or_the_missing_netem_is_named(inside):
    kernel_has_netem = inside(["tc", "qdisc", "add", "dev", "va", "root", "netem"]).returncode == 0
    netem.remove("va", inside)
    if not kernel_has_netem:
        with pytest.raises(SetupError, match="has no netem"):
            netem.run_network(load_config(), "s2", "va", "apply", inside)
        assert "tbf" not in netem.show("va", inside)
        return
    netem.run_network(load_config(), "s2", "va", "apply", inside)
    assert "tbf 2:" in netem.show("va", inside)
    assert "delay 40ms" in netem.show("va", inside)


def test_without_root_the_command_says_to_use_sudo(inside):
    if not shutil.which("setpriv"):
        pytest.skip("setpriv is not installed")
    unprivileged = ["setpriv", "--reuid", "65534", "--clear-groups"]
    with pytest.raises(SetupError, match="needs root; run the command again with sudo"):
        netem.apply(
            netem.commands(S2, "va", rate_only=True),
            "va",
            lambda command: inside([*unprivileged, *command]),
        )
