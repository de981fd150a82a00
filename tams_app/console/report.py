"""What a session leaves for people: summary.json, the figure of the bitrates, a table."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from tams_app.errors import LogError, UnreadableLogError
from tams_app.recording import read_log
from tams_app.session.recorders import LOG_NAME
from tams_app.summary.joined import in_order, summarise_both
from tams_app.summary.summarise import save_summary
from tams_app.summary.summarise import write_summary as save_summary_of

FIGURE_NAME = "bitrates.png"
_NOTHING = "–"


def report_session(folder: Path, console: Console | None = None) -> dict[str, Any]:
    """Compute summary.json and bitrates.png from the log in `folder`; show the summary, return it.

    `folder` may name the log itself. UnreadableLogError if there is no log,
    or none of ours; LogError if the folder cannot be written.
    """
    folder = _session_folder(folder)
    summary = write_summary(folder)
    console = console or Console()
    console.print(summary_tables(summary))
    if missing := _missing(summary):
        console.print(missing, style="bold", highlight=False, soft_wrap=True)
    console.print(f"[bold]{folder}[/]", highlight=False)
    return summary


def report_both(first: Path, second: Path, console: Console | None = None) -> dict[str, Any]:
    """As `report_session`, of the two logs of one session, into the folder of the robot's side."""
    from tams_app.study.figures import save_bitrates

    folders = [_session_folder(one) for one in (first, second)]
    logs = [read_log(folder / LOG_NAME) for folder in folders]
    robot, operator = in_order(*logs)
    folder = folders[0] if robot is logs[0] else folders[1]
    summary = summarise_both(robot, operator)
    save_summary_of(summary, folder)
    try:
        save_bitrates(robot, folder / FIGURE_NAME)
    except OSError as error:
        raise LogError(f"{folder}: the figure cannot be written: {error.strerror}") from error
    console = console or Console()
    console.print(summary_tables(summary), link_table(summary["link"]))
    if missing := _missing(summary):
        console.print(missing, style="bold", highlight=False, soft_wrap=True)
    console.print(f"[bold]{folder}[/]", highlight=False)
    return summary


def link_table(link: Mapping[str, Any]) -> Table:
    """What the link between two computers did."""
    ages, commands, trips = link["sample_age_ms"], link["command_latency_ms"], link["round_trip_ms"]
    refused = ", ".join(
        f"{number} {reason}" for reason, number in link["samples"]["refused"].items()
    )
    rows = {
        "Link": f"round trip p50 {_number(trips['p50'], '{:.0f} ms')}, "
        f"p99 {_number(trips['p99'], '{:.0f} ms')}; times between the two computers are right to "
        f"within {link['uncertainty_ms']:.1f} ms",
        "Hand": f"age of a sample p50 {_number(ages['p50'], '{:.0f} ms')}, "
        f"p99 {_number(ages['p99'], '{:.0f} ms')}; to the command p50 "
        f"{_number(commands['p50'], '{:.0f} ms')}, p99 {_number(commands['p99'], '{:.0f} ms')}; "
        f"{link['samples']['counted']} of {link['samples']['heard']} counted"
        + (f" ({refused})" if refused else ""),
    }
    table = Table.grid(padding=(0, 2))
    for name, value in rows.items():
        table.add_row(Text(name, style="dim"), Text(value))
    return table


def write_summary(folder: Path) -> dict[str, Any]:
    """Compute summary.json, bitrates.png and report.html from the log in `folder`, show nothing."""
    # matplotlib and jinja2: no session starts with them
    from tams_app.study.figures import save_bitrates
    from tams_app.study.session_page import write_page

    log = read_log(folder / LOG_NAME)
    summary = save_summary(log, folder)
    try:
        save_bitrates(log, folder / FIGURE_NAME)
    except OSError as error:
        raise LogError(f"{folder}: the figure cannot be written: {error.strerror}") from error
    write_page(log, summary, folder / LOG_NAME)
    return summary


def session_log(given: Path) -> Path:
    """The log in a session's folder, or the log itself; UnreadableLogError if there is none."""
    return _session_folder(given) / LOG_NAME


def _session_folder(given: Path) -> Path:
    if os.path.isfile(given):
        if given.name != LOG_NAME:
            raise UnreadableLogError(
                f"{given}: is not a session: give the folder that holds {LOG_NAME}"
            )
        return given.parent
    if not os.path.isdir(given):
        raise UnreadableLogError(f"{given}: there is no such folder: give a session folder")
    if not os.path.isfile(given / LOG_NAME):
        raise UnreadableLogError(f"{given}: holds no {LOG_NAME}: give a session folder")
    return given


def _missing(summary: Mapping[str, Any]) -> str:
    """What the log lacks, in one sentence; empty if it is whole."""
    if summary["complete"]:
        return ""
    lost = [gap for gap in summary["missing"] if gap["end_s"] is not None]
    if not lost:
        return (
            "The log ends early (the session was killed, the disk was full, or the file was cut or "
            "damaged): these figures cover only what was written before."
        )
    times = ", ".join(f"{gap['start_s']:.1f} to {gap['end_s']:.1f} s" for gap in lost)
    return f"The log is damaged: these figures are without what was recorded at {times}."


def summary_tables(summary: Mapping[str, Any]) -> RenderableType:
    """The headline, the session's figures and one row per view of a summary.json."""
    return Group(_headline(summary), _session_table(summary), _view_table(summary["views"]))


def _headline(summary: Mapping[str, Any]) -> Text:
    outcome = summary["outcome"]
    if outcome["completed"] is None:
        verdict = "no verdict on the task"
    elif outcome["completed"]:
        time_s = _number(outcome["completion_time_s"], "{:.1f} s")
        verdict = f"completed in {time_s}, drops: {outcome['drops']}"
        verdict += ", success" if outcome["success"] else ", no success"
    else:
        verdict = f"not completed, drops: {outcome['drops']}"
    reason = f" ({outcome['reason']})" if outcome["reason"] else ""
    shortfall = summary["rates"]["shortfall"]
    return Text(
        f"{summary['strategy']} on {summary['network']}, {summary['duration_s']:.1f} s: "
        f"{verdict}{reason}" + (f"\n{shortfall}" if shortfall else ""),
        style="bold",
    )


def _session_table(summary: Mapping[str, Any]) -> Table:
    control, arm, uplink = summary["control"], summary["arm"], summary["uplink"]
    stops = [stop["stop_time_ms"] for stop in arm["stops"] if stop["stop_time_ms"] is not None]
    rows = {
        "Control loop": f"{_number(control['rate_hz'], '{:g} Hz')}, {control['ticks']} ticks, "
        f"late {_percent(control['late_fraction'], 2)} ({control['skipped']} skipped), "
        f"period error p99 {_number(control['period_error_ms']['p99'], '{:.2f} ms')}",
        "Arm": f"round trip p50 {_number(arm['round_trip_ms']['p50'], '{:.1f} ms')}, "
        f"p99 {_number(arm['round_trip_ms']['p99'], '{:.1f} ms')}; stops: {len(arm['stops'])}"
        + (f", longest {max(stops):.0f} ms" if stops else ""),
        "Uplink": f"{_number(uplink['sent_kbps_mean'], '{:.0f}')} of "
        f"{_number(uplink['capacity_kbps'], '{:.0f}')} kbit/s, "
        f"used {_percent(uplink['utilisation'], 0)}, "
        f"queue p95 {_number(uplink['queue_ms']['p95'], '{:.0f} ms')}",
        "Loss": f"{_percent(uplink['loss_fraction'], 2)} before repair, "
        f"{_percent(uplink['residual_loss_fraction'], 2)} after",
        "Primary view": _quality(summary["primary_view"]),
        "Load": f"application {_number(summary['system']['cpu_percent']['app'], '{:.0f} %')}, "
        f"helpers {_number(summary['system']['cpu_percent']['helpers'], '{:.0f} %')} of a core, "
        f"{_number(summary['system']['peak_rss_mb'], '{:.0f} MB')} at most",
    }
    table = Table.grid(padding=(0, 2))
    for name, value in rows.items():
        table.add_row(Text(name, style="dim"), Text(value))
    return table


def _quality(primary: Mapping[str, Any]) -> str:
    names = ("received", "delivered", "live")
    scores = [f"{name} {_number(primary[f'{name}_ssim'], '{:.3f}')}" for name in names]
    return f"SSIM {', '.join(scores)}; {_percent(primary['sampled_fraction'], 0)} compared"


def _view_table(views: Mapping[str, Mapping[str, Any]]) -> Table:
    table = Table(
        box=None, header_style="dim", padding=(0, 1), collapse_padding=True, pad_edge=False
    )
    table.add_column("View")
    for name in (
        "target",
        "sent kbit/s",
        "error",
        "fps",
        "shown",
        "p50 ms",
        "p95 ms",
        "freezes",
        "SSIM",
    ):
        table.add_column(name, justify="right")
    for view, entry in views.items():
        latency, freezes = entry["latency_ms"], entry["freezes"]
        table.add_row(
            view.upper(),
            _number(entry["target_kbps_mean"], "{:.0f}"),
            _number(entry["sent_kbps_mean"], "{:.0f}"),
            _percent(entry["tracking_error"], 1),
            f"{_number(entry['fps']['given'], '{:.1f}')}/{entry['fps']['asked']:g}",
            f"{entry['frames_shown']}/{entry['frames_captured']}",
            _number(latency["p50"], "{:.0f}"),
            _number(latency["p95"], "{:.0f}"),
            _number(freezes["count"], "{:d}") + _seconds(freezes["total_s"]),
            _number(entry["received_ssim"], "{:.3f}"),
        )
    return table


def _number(value: float | None, form: str) -> str:
    return _NOTHING if value is None else form.format(value)


def _percent(value: float | None, digits: int) -> str:
    return _NOTHING if value is None else f"{100 * value:.{digits}f} %"


def _seconds(value: float | None) -> str:
    return f" ({value:.1f} s)" if value else ""
