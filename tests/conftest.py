"""What holds for every test."""

import functools
import gc
import re
import signal
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from tests.matrix import Matrix
from tests.real_time import require_real_time
from tests.second_chance import SecondChances
from tests.standstills import Standstills

settings.register_profile("unhurried", deadline=None)  # a busy machine breaks no promise
settings.load_profile("unhurried")

# `--hypothesis-profile=steady`: the same examples in every run, so that a change is judged by what
# it changes, and a mutant dies by a test. `make explore` draws new examples.
settings.register_profile("steady", derandomize=True, database=None, deadline=None)

GROUPS = ("untimed", "waiting", "timed")


NAMED_GROUP = re.compile(rf"^pytestmark\b.*?\bpytest\.mark\.({'|'.join(GROUPS)})\b", re.M | re.S)


def pytest_addoption(parser):
    parser.addoption("--times", type=int, help="how often the matrix is run")
    parser.addoption(
        "--group", choices=GROUPS, help="only modules of this group, and load no other"
    )


def pytest_ignore_collect(collection_path: Path, config):
    """Loading all modules takes a minute, and each process of a run loads all that it collects."""
    group = config.getoption("--group")
    if group is None or not collection_path.name.startswith("test_"):
        return None
    return True if named_group(collection_path) not in (None, group) else None


@functools.cache
def named_group(module: Path) -> str | None:
    """The group that a module's source names."""
    named = NAMED_GROUP.search(module.read_text())
    return None if named is None else named[1]


def pytest_configure(config):
    config.pluginmanager.register(SecondChances(Standstills()))
    config.pluginmanager.register(Matrix(config.getoption("--times")))
    # A run in a shell's background ignores Ctrl-C, and so would every process that tests interrupt.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items):
    """Every test belongs to one group of `make test`: its module says which (`pytestmark`)."""
    for item in items:
        groups = [name for name in GROUPS if item.get_closest_marker(name)]
        if len(groups) != 1:
            raise pytest.UsageError(
                f"{item.nodeid}: pytestmark must name one of {', '.join(GROUPS)}, not {groups}"
            )
        if named_group(item.path) != groups[0]:
            raise pytest.UsageError(f"{item.path}: --group finds no {groups[0]} in its pytestmark")


def pytest_collection_finish():
    """What was collected lives as long as the run: looking through it takes 280 ms of CPU time.

    For so long no thread runs, and the guard, which waits for 100 ms, rightly stops an arm that a
    test leads. Sessions do the same with what lives as long as they do.
    """
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="module")
def turn(request):
    """Which of the matrix's turns this is; what a module's tests share is made anew in each."""
    return getattr(request, "param", 0)


@pytest.fixture
def real_time():
    """The machine keeps real time at this moment; a test that needs that is skipped elsewhere."""
    require_real_time()


@pytest.fixture
def tams(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Runs a command in this process: exit code, what it printed, and its errors."""
    from tams_app.cli import _main  # most tests need none

    def run(*arguments: object) -> tuple[int, str, str]:
        capsys.readouterr()  # what was printed before is none of it
        code = _main([*map(str, arguments)])
        return code, *capsys.readouterr()

    return run


@pytest.fixture(autouse=True)
def _no_default_timeout():
    """The xArm SDK sets a time-out for all sockets of the process: no test passes it on."""
    yield
    socket.setdefaulttimeout(None)


@pytest.fixture
def screen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """That of an X server, which DISPLAY names."""
    from tests.faces.window.xvfb import virtual_screen  # most tests need none

    with virtual_screen(tmp_path, monkeypatch) as found:
        yield found


@pytest.fixture
def glib_complaints() -> Iterator[list[str]]:
    """Criticals and warnings of GLib's log; a test that provokes one clears the list."""
    from tams_app import gst  # tests without GStreamer need not load it

    glib = gst.load().GLib
    complaints: list[str] = []
    levels = glib.LogLevelFlags.LEVEL_CRITICAL | glib.LogLevelFlags.LEVEL_WARNING

    def note(domain: str, level: object, message: str, *_: object) -> None:
        complaints.append(f"{domain}: {message}")

    domains = ("GStreamer", "GLib", "GLib-GObject", "GLib-GIO")
    handlers = [(domain, glib.log_set_handler(domain, levels, note, None)) for domain in domains]
    yield complaints
    for domain, handler in handlers:
        glib.log_remove_handler(domain, handler)
    assert complaints == []
