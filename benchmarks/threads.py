"""Where the processor time of a live session goes: `python -m benchmarks.threads`.

Share of a core by thread of the application and by helper process, while the control loop runs.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks.checkouts import Checkout, Setting, run_session
from benchmarks.processor_time import DECODING, ENCODING, Profile
from tams_app.errors import TamsError
from tams_app.runtime.process import PROJECT_DIRECTORY

_DOES = {**dict.fromkeys(ENCODING, " (encoding)"), **dict.fromkeys(DECODING, " (decoding)")}
_LEAST_SHARE = 0.0005  # of a core; threads below are counted together


def shares(profile: Profile) -> dict[str, dict[str, float]]:
    """Shares of a core: `application` by thread, `processes` by name; the largest first.

    `ended` is the time of threads that ended between two samples.
    """
    threads = dict(profile.threads)
    threads["ended"] = max(0.0, profile.application_s - sum(threads.values()))
    processes = {"application": profile.application_s, **profile.helpers}
    return {
        name: {
            part: round(used / profile.seconds, 4)
            for part, used in sorted(parts.items(), key=lambda entry: -entry[1])
        }
        for name, parts in (("application", threads), ("processes", processes))
    }


def table(profile: Profile) -> Table:
    shown = Table(box=None)
    shown.add_column("")
    shown.add_column("% of a core", justify="right")
    parts = shares(profile)
    for process, share in parts["processes"].items():
        shown.add_row(f"[bold]{process}[/]", f"{share:.1%}"[:-1])
        if process != "application":
            continue
        small = 0.0
        for thread, used in parts["application"].items():
            if used < _LEAST_SHARE:
                small += used
                continue
            shown.add_row(f"  {thread}{_DOES.get(thread, '')}", f"{used:.1%}"[:-1])
        shown.add_row("  others together", f"{small:.1%}"[:-1])
    return shown


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.threads", description=__doc__)
    parser.add_argument("--of", type=Path, default=PROJECT_DIRECTORY, help="another checkout")
    parser.add_argument("--fps", type=int, default=5, help="frames a second of a view (default 5)")
    parser.add_argument("--seed", type=int, default=4)
    parser.add_argument("--seconds", type=float, default=30.0, help="of the session, at most")
    options = parser.parse_args()
    console = Console()
    setting = Setting(options.seed, options.fps, options.seconds)
    try:
        with console.status(f"a session of {options.seconds:g} s"):
            cost = run_session(Checkout.at(options.of), setting)
    except (RuntimeError, TamsError) as error:
        console.print(f"the session failed: {error}", highlight=False, soft_wrap=True)
        return 1
    except KeyboardInterrupt:
        return 130
    console.print(table(cost.profile))
    given = cost.measures["fps_given"]
    console.print(
        f"over {cost.profile.seconds:.0f} s, {given:.1f} of {options.fps} frames a second; "
        f"other programs took {cost.profile.others_s / cost.profile.seconds:.0%} of a core",
        highlight=False,
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
