"""How much memory a log takes that is written for hours: `python -m benchmarks.log_memory`.

A trial in virtual time gives the messages, with viewers' channels and video; they are written again
and again, with a chunk each second, as fast as they can be: once as sessions write them and once
with the SDK's own chunks, each in a process of its own. Growth is that of anonymous memory, which
other programs do not change, by a line through what came after the first fifth.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from foxglove import Context, Schema, open_mcap
from foxglove.mcap import MCAPCompression, MCAPWriteOptions
from mcap.reader import make_reader

from benchmarks.link.soak import anonymous_mb
from tams_app.config import load_config
from tams_app.recording import LOG_NAME
from tams_app.recording.mcap_file import McapFile
from tams_app.recording.topics import PROFILE
from tams_app.session.virtual.runner import run_virtual_trial
from tams_app.study.runner import machine
from tams_app.units import NS_PER_S

RESULTS = Path(__file__).parent / "results" / "log_memory.json"
SETTINGS = {"network": "s2", "seed": 1, "seconds": 20.0, "video.fps": 10}
TARGET = 0.05  # of the growth with the SDK's chunks
S_PER_H = 3600
_SAMPLED_EACH_S = 120  # of log
_FIRST_S = 2  # of the trial are left out, and its last: a session's middle is what repeats


class Writer(Protocol):
    """A file of what is logged in a context."""

    def flush(self) -> None: ...

    def close(self) -> None: ...


def _session_writer(path: Path, context: Context) -> Writer:
    return McapFile(path, context, PROFILE)


def _sdk_writer(path: Path, context: Context) -> Writer:
    """The SDK's own chunks, each written whole."""
    options = MCAPWriteOptions(
        compression=MCAPCompression.Zstd,
        compression_threads=0,
        profile=PROFILE,
        disable_seeking=True,
    )
    return open_mcap(path, context=context, writer_options=options)


WRITERS: dict[str, Callable[[Path, Context], Writer]] = {
    "session": _session_writer,
    "sdk": _sdk_writer,
}


@dataclass(frozen=True, slots=True)
class Recorded:
    """Messages of a log: `seconds` has (channel, time since the first second [ns], data)."""

    channels: dict[int, tuple[str, str, Schema]]
    seconds: list[list[tuple[int, int, bytes]]]

    @staticmethod
    def of(path: Path) -> Recorded:
        """The middle of the log at `path`, second by second."""
        channels: dict[int, tuple[str, str, Schema]] = {}
        by_second: dict[int, list[tuple[int, int, bytes]]] = {}
        with path.open("rb") as stream:
            first_ns: int | None = None
            for schema, channel, message in make_reader(stream).iter_messages():
                assert schema is not None
                first_ns = message.log_time if first_ns is None else first_ns
                channels[channel.id] = (
                    channel.topic,
                    channel.message_encoding,
                    Schema(name=schema.name, encoding=schema.encoding, data=schema.data),
                )
                since_ns = message.log_time - first_ns
                row = (channel.id, since_ns, message.data)
                by_second.setdefault(since_ns // NS_PER_S, []).append(row)
        return Recorded(channels, [by_second[number] for number in sorted(by_second)][_FIRST_S:-1])


def write(recorded: Recorded, writer: str, path: Path, hours: float) -> dict[str, float]:
    """Write `hours` of log, a chunk each second; memory, time to close, and processor time."""
    context = Context()
    file = WRITERS[writer](path, context)
    channels = {
        number: context._create_channel(topic, message_encoding=encoding, schema=schema)
        for number, (topic, encoding, schema) in recorded.channels.items()
    }
    length_s = round(hours * S_PER_H)
    hours_written, memory_kb = [], []
    began_s = time.process_time()
    for number in range(length_s):
        turn, second = divmod(number, len(recorded.seconds))
        turn_ns = turn * len(recorded.seconds) * NS_PER_S
        for channel, since_ns, data in recorded.seconds[second]:
            channels[channel].log(data, turn_ns + since_ns)
        file.flush()
        if number % _SAMPLED_EACH_S == 0 and number >= length_s / 5:
            hours_written.append(number / S_PER_H)
            memory_kb.append(anonymous_mb(os.getpid()) * 1e3)
    processor_s = time.process_time() - began_s
    closing_s = time.perf_counter()
    file.close()
    return {
        "growth_kb_per_h": round(float(np.polyfit(hours_written, memory_kb, 1)[0]), 1)
        + 0.0,  # no -0.0
        "close_s": round(time.perf_counter() - closing_s, 3),
        "processor_ms_per_s": round(processor_s * 1e3 / length_s, 2),
        "log_mb": round(path.stat().st_size / 1e6),
    }


def main() -> None:
    parser = argparse.ArgumentParser(prog="benchmarks.log_memory", description=__doc__)
    parser.add_argument("--hours", type=float, default=2.0, help="of log (default 2)")
    parser.add_argument("--json", type=Path, default=RESULTS)
    parser.add_argument("--of", type=Path, help=argparse.SUPPRESS)  # of a process of its own
    parser.add_argument("--writer", choices=WRITERS, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.of:
        path = options.of.with_name(f"written-by-{options.writer}.mcap")
        found = write(Recorded.of(options.of), options.writer, path, options.hours)
        path.unlink()
        print(json.dumps(found))
        return
    with tempfile.TemporaryDirectory(prefix="tams-log-") as folder:
        run_virtual_trial(load_config(None, SETTINGS), 1, Path(folder), time.time_ns())
        log = Path(folder) / LOG_NAME
        recorded = Recorded.of(log)
        seconds = recorded.seconds
        result: dict[str, Any] = {
            "command": f"python -m benchmarks.log_memory --hours {options.hours:g}",
            "machine": machine(),
            "channels_per_s": round(float(np.mean([len({m[0] for m in s}) for s in seconds])), 1),
            "messages_per_s": round(float(np.mean([len(s) for s in seconds]))),
            "kb_per_s": round(float(np.mean([sum(len(m[2]) for m in s) for s in seconds])) / 1e3),
        }
        for writer in WRITERS:
            command = [sys.executable, "-m", "benchmarks.log_memory", "--of", str(log)]
            command += ["--writer", writer, "--hours", str(options.hours)]
            done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
            result[writer] = json.loads(done.stdout)
            print(f"{writer}: {done.stdout.strip()}", flush=True)
    ours, sdk = (result[writer]["growth_kb_per_h"] for writer in ("session", "sdk"))
    result["growth_of_sdk"] = round(ours / sdk, 4)
    print(f"growth of the SDK's: {result['growth_of_sdk']:.1%} (target: at most {TARGET:.0%})")
    options.json.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
