"""YAML of any kind and from anywhere: one sentence, in bounded time and memory."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import pytest

from tams_app.config import DEFAULT_CONFIG, load_config
from tams_app.config.yaml_file import LONGEST_FILE_BYTES, MOST_REPEATED, read_yaml
from tams_app.errors import ConfigError

pytestmark = pytest.mark.untimed

CPU_S, MEMORY_MB = 20, 150  # of reading one file; more memory than the interpreter has before


def laughs(levels: int, first: str = "x") -> str:
    """A list of nine, nine times that, and so on."""
    lines = [f"a: &a [{', '.join([first] * 9)}]"]
    for before, name in pairwise("abcdefghijk"[: levels + 1]):
        lines.append(f"{name}: &{name} [{', '.join([f'*{before}'] * 9)}]")
    return "\n".join(lines) + "\n"


def included(path: object) -> str:
    return f"version: 1\ninclude: [{path}]\n"


ODD = {
    "aliases of aliases": (laughs(8), "line 5: aliases stand for more than 10000 values"),
    "aliases of text": (
        f"a: &a {'x' * 100_000}\nb: [{', '.join(['*a'] * 100)}]\n",
        "line 2: aliases stand for more than",
    ),
    "merged aliases": (
        "a: &a {"
        + ", ".join(f"k{n}: 1" for n in range(300))
        + "}\n"
        + "".join(
            f"{name}: &{name} {{<<: [{', '.join([f'*{before}'] * 9)}]}}\n"
            for before, name in pairwise("abcde")
        ),
        "aliases stand for more than",
    ),
    "an alias of itself": ("limits: &l {max_speed_mm_s: *l}\n", "an alias is part of what it"),
    "deep lists": ("x: " + "[" * 100_000, "line 1: is nested more than 40 deep"),
    "deep keys": ("{a: " * 50_000, "line 1: is nested more than 40 deep"),
    "an integer of very many digits": ("seed: " + "9" * 200_000, "more than 100 characters"),
    "an integer of more than 64 bits": ("seed: 99999999999999999999", "more than 64 bits"),
    "an integer to base 60": ("seed: 1" + ":1" * 100_000, "more than 100 characters"),
    "a fraction to base 60": ("seconds: 1" + ":1" * 100_000 + ".5", "more than 100 characters"),
    "infinity": ("seconds: .inf", "seconds: must be a finite number (given: infinity)"),
    "no number": ("seconds: .nan", "seconds: must be "),
    "no truth value": ("headless: !!bool x", "line 1: is not a value of the kind bool"),
    "no time": ("version: 1\nseed: !!timestamp x", "line 2: is not a value of the kind timestamp"),
    "no such day": ("seed: 2001-99-99", "line 1: is not a value of the kind timestamp"),
    "an empty integer": ("seed: !!int ''", "line 1: is not a value of the kind int"),
    "an empty fraction": ("seconds: !!float ''", "line 1: is not a value of the kind float"),
    "very many unknown keys": (
        "".join(f"key{number}: 1\n" for number in range(15_000)),
        "more",
    ),
    "a large file": ("# " + "x" * LONGEST_FILE_BYTES, "is larger than 256 kB"),
    "bytes that are no text": ("version: 1\n\x00", "is not valid YAML"),
    "an included folder": (included("/"), "/: cannot be read: Is a directory"),
    "an included device": (included("/dev/zero"), "/dev/zero: cannot be read: is not a regular"),
    "an included file of another kind": (included(DEFAULT_CONFIG.parents[1] / "setup.sh"), ": "),
}

_READS = """
import json
import resource
import sys
import time
from pathlib import Path

from tams_app.config import load_config
from tams_app.errors import ConfigError


def peak_mb():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


load_config()
before_mb = peak_mb()
for path in sys.argv[1:]:
    begun_s = time.process_time()
    try:
        load_config(Path(path))
    except ConfigError as error:
        sentence = str(error)
    took_s = time.process_time() - begun_s
    print(json.dumps([sentence, took_s, peak_mb() - before_mb]), flush=True)
    del sentence
"""


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[str, float, float]]:
    """What a process says of each, which reads one after the other: how long, how much memory."""
    folder = tmp_path_factory.mktemp("odd")
    paths = []
    for number, (text, _) in enumerate(ODD.values()):
        paths.append(folder / f"{number}.yaml")
        paths[-1].write_text(text)
    done = subprocess.run(
        [sys.executable, "-c", _READS, *map(str, paths)],
        capture_output=True,
        text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (3 * CPU_S, 3 * CPU_S)),
        check=False,
    )
    found = dict(zip(ODD, map(json.loads, done.stdout.splitlines()), strict=False))
    assert (done.returncode, done.stderr) == (0, ""), f"after {[*found]}"
    return found


@pytest.mark.parametrize("name", ODD)
def test_odd_yaml_is_one_sentence_in_bounded_time_and_memory(
    told: dict[str, tuple[str, float, float]], name: str
) -> None:
    sentence, took_s, more_mb = told[name]
    assert ODD[name][1] in sentence
    assert "\n" not in sentence
    assert len(sentence) < 10_000
    assert took_s < CPU_S
    assert more_mb < MEMORY_MB


def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.yaml"
    os.mkfifo(pipe)
    begun_s = time.process_time()
    with pytest.raises(ConfigError, match=r"pipe\.yaml: cannot be read: is not a regular file"):
        load_config(pipe)
    assert time.process_time() - begun_s < CPU_S


def test_anchors_of_a_person_s_own_work_up_to_the_bound(tmp_path: Path) -> None:
    path = tmp_path / "anchors.yaml"
    lists = MOST_REPEATED // 10
    path.write_text(
        f"ten: &ten [{', '.join('123456789')}]\nmany: [{', '.join(['*ten'] * lists)}]\n"
    )
    assert read_yaml(path)["many"] == [list(range(1, 10))] * lists
    path.write_text(path.read_text() + "one_more: *ten\n")
    with pytest.raises(ConfigError, match="line 3: aliases stand for more than"):
        read_yaml(path)


def test_numbers_are_read_as_before(tmp_path: Path) -> None:
    path = tmp_path / "numbers.yaml"
    path.write_text("a: 12\nb: -1_000\nc: 0x1F\nd: 0\ne: 0.5\nf: -.inf\ng: 9223372036854775807\n")
    assert read_yaml(path) == {
        "a": 12,
        "b": -1000,
        "c": 31,
        "d": 0,
        "e": 0.5,
        "f": float("-inf"),
        "g": 2**63 - 1,
    }


@pytest.mark.parametrize("word", ["on", "off", "yes", "no", "On", "OFF", "y", "N"])
def test_a_word_that_old_yaml_takes_for_a_truth_value_is_a_word(word: str, tmp_path: Path) -> None:
    path = tmp_path / "words.yaml"
    path.write_text(f"a: {word}\n{word}: 1\nb: [true, False]\n")
    assert read_yaml(path) == {"a": word, word: 1, "b": [True, False]}


def test_documented_words_and_truth_values_work_without_quotes(tmp_path: Path) -> None:
    path = tmp_path / "words.yaml"
    path.write_text(
        f"version: 1\ninclude: [{DEFAULT_CONFIG}]\n"
        "view: {predict: off}\n"
        "video: {repair: {rtx: off, parity: on}, quality: {enabled: no}}\n"
    )
    config = load_config(path)
    assert (config.view.predict, config.video.repair.rtx) == ("off", "off")
    assert config.video.repair.parity == "on"
    assert config.video.quality.enabled is False


@pytest.mark.parametrize("number", ["010", "-007", "0123", "12:30", "1:2:3", "190:20:30.15"])
def test_a_number_that_yaml_1_1_and_1_2_read_differently_is_refused(
    number: str, tmp_path: Path
) -> None:
    """`serial: 0123` was 83, and `seed: 010` was 8."""
    path = tmp_path / "numbers.yaml"
    path.write_text(f"a: 1\nb: {number}\n")
    with pytest.raises(ConfigError, match=f"{number} is one number in YAML 1.1"):
        read_yaml(path)
    path.write_text(f"b: '{number}'\n")
    assert read_yaml(path) == {"b": number}
