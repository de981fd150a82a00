"""The table at the end of a session: summary.json for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console as RichConsole  # noqa: TID251  draws nothing here
from rich.console import ConsoleOptions, Group, RenderableType, RenderResult
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from tams_app.printing import known
from tams_app.records import EpisodeState
from tams_app.task.episodes import verdict

_STOPS_NAMED = 5
_ANY_WIDTH = 10_000  # columns; more than any row of a table


def summary_tables(summary: Mapping[str, Any], seen_elsewhere: bool = False) -> RenderableType:
    """The headline, the session's figures and one row per view of a summary.json.

    `seen_elsewhere`: the frames were shown by the other side of two, of which nothing is known.
    """
    views = _ViewsTable(summary["views"], seen_elsewhere)
    return Group(_headline(summary), _session_table(summary, seen_elsewhere), views)


def seen_tables(summary: Mapping[str, Any]) -> RenderableType:
    """The figures of the operator's log alone (`seen` of its summary.json), below the headline."""
    seen, system = summary["seen"], summary["system"]
    shown = ", ".join(
        f"{view.upper()} {one['frames']} ({one['per_s']:.1f} a second)"
        for view, one in seen["shown"].items()
    )
    rows = {
        "Link": f"round trip {_p50_p99(seen['round_trip_ms'])}; "
        f"{seen['messages']} messages of the robot's side, "
        f"longest gap {known(seen['longest_gap_ms'], '{:.0f} ms')}",
        "Frames shown": shown,
        "Load": _load(system),
        "Needs both logs": "stops, latency, freezes, quality and what the uplink carried",
    }
    return Group(_headline(summary), _named_rows(rows))


def _named_rows(rows: Mapping[str, str | Table]) -> Table:
    table = Table.grid(padding=(0, 2))
    for name, value in rows.items():
        if value:
            table.add_row(Text(name, style="dim"), Text(value) if isinstance(value, str) else value)
    return table


def link_table(link: Mapping[str, Any]) -> Table:
    """The figures of the link between two computers."""
    refused = ", ".join(
        f"{number} {reason}" for reason, number in link["samples"]["refused"].items()
    )
    rows = {
        "Link": f"round trip {_p50_p99(link['round_trip_ms'])}; times between the two "
        f"computers are right to within {link['uncertainty_ms']:.1f} ms",
        "Hand": f"age of a sample {_p50_p99(link['sample_age_ms'])}; "
        f"to the command {_p50_p99(link['command_latency_ms'])}; "
        f"{link['samples']['counted']} of {link['samples']['heard']} counted"
        + (f" ({refused})" if refused else ""),
    }
    if stops := link["stops_per_minute"]:
        listed = ", ".join(f"{reason} {number:g}" for reason, number in stops.items())
        rows["Stopped by it"] = f"{listed} times a minute"
    return _named_rows(rows)


def _p50_p99(figures: Mapping[str, Any], form: str = "{:.0f} ms") -> str:
    return f"p50 {known(figures['p50'], form)}, p99 {known(figures['p99'], form)}"


def _load(system: Mapping[str, Any]) -> str:
    app, helpers = (known(system["cpu_percent"][name], "{:.0f} %") for name in ("app", "helpers"))
    return f"application {app}, helpers {helpers} of a core"


def task_verdict(summary: Mapping[str, Any]) -> str:
    """The result of the task; of a session with episodes, how many there are."""
    if episodes := summary.get("episodes"):
        kept = sum(one["kept"] for one in episodes)
        what = "episode" if kept == 1 else "episodes"
        return f"{kept} {what} kept, {len(episodes) - kept} discarded"
    outcome = summary["outcome"]
    if outcome["completed"] is None:
        return "no verdict on the task"
    if not outcome["completed"]:
        drops = outcome["drops"]
        return "not completed" + ("" if drops is None else f", drops: {drops}")
    if outcome["success"] is None:  # as the operator's side alone knows it
        return "the block is placed"
    time_s = known(outcome["completion_time_s"], "{:.1f} s")
    success = "success" if outcome["success"] else "no success"
    return f"completed in {time_s}, drops: {outcome['drops']}, {success}"


def _headline(summary: Mapping[str, Any]) -> Text:
    outcome = summary["outcome"]
    reason = f" ({outcome['reason']})" if outcome["reason"] else ""
    shortfall = summary["rates"]["shortfall"]
    return Text(
        f"{summary['strategy']} on {summary['network']}, {summary['duration_s']:.1f} s: "
        f"{task_verdict(summary)}{reason}" + (f"\n{shortfall}" if shortfall else ""),
        style="bold",
    )


def _session_table(summary: Mapping[str, Any], seen_elsewhere: bool) -> Table:
    control, arm, uplink = summary["control"], summary["arm"], summary["uplink"]
    stops = [stop["stop_time_ms"] for stop in arm["stops"] if stop["stop_time_ms"] is not None]
    rows: dict[str, str | Table] = {
        "Episodes": _episodes(summary.get("episodes", ())),
        "Control loop": f"{known(control['rate_hz'], '{:g} Hz')}, {control['ticks']} ticks, "
        f"late {_percent(control['late_fraction'], 2)} ({control['skipped']} skipped), "
        f"period error p99 {known(control['period_error_ms']['p99'], '{:.2f} ms')}",
        "Arm": f"round trip {_p50_p99(arm['round_trip_ms'], '{:.1f} ms')}; "
        f"stops: {len(arm['stops'])}" + (f", longest {max(stops):.0f} ms" if stops else ""),
        "Stops": _listed(stop_texts(arm["stops"])) if arm["stops"] else "",
        "Uplink": f"{known(uplink['sent_kbps_mean'], '{:.0f}')} of "
        f"{known(uplink['capacity_kbps'], '{:.0f}')} kbit/s, "
        f"used {_percent(uplink['utilisation'], 0)}, "
        f"queue p95 {known(uplink['queue_ms']['p95'], '{:.0f} ms')}",
        "Loss": f"{_percent(uplink['loss_fraction'], 2)} before repair, "
        f"{_percent(uplink['residual_loss_fraction'], 2)} after",
        "Freezes": _freezes(summary["views"]),
        "Primary view": "" if seen_elsewhere else _quality(summary["primary_view"]),
        "Load": f"{_load(summary['system'])}, "
        f"{known(summary['system']['peak_rss_mb'], '{:.0f} MB')} at most",
    }
    return _named_rows(rows)


def _episodes(episodes: Sequence[Mapping[str, Any]]) -> str | Table:
    """Each episode: when it began, its length, and what has become of it; empty without any."""
    rows = []
    for one in episodes:
        episode = EpisodeState(one["number"], one["length_s"], one["kept"], one["success"])
        outcome = f"at {one['t_s']:.1f} s, {one['length_s']:.1f} s long: {verdict(episode)}"
        rows.append((str(one["number"]), outcome))
    return _listed(rows) if rows else ""


def stop_texts(stops: Sequence[Mapping[str, Any]]) -> list[tuple[str, str]]:
    """The first stops: when each was, why, and how long the arm took to rest."""
    texts = []
    for stop in stops[:_STOPS_NAMED]:
        rest_ms = stop["stop_time_ms"]
        rest = "not at rest at the end" if rest_ms is None else f"at rest after {rest_ms:.0f} ms"
        texts.append((f"{stop['t_s']:.1f} s", f"{stop['reason']}, {rest}"))
    if (more := len(stops) - _STOPS_NAMED) > 0:
        texts.append(("…", f"and {more} more"))
    return texts


def _listed(rows: Sequence[tuple[str, str]]) -> Table:
    table = Table.grid(padding=(0, 1))
    table.add_column(justify="right")
    for first, text in rows:
        table.add_row(first, Text(text))
    return table


def _freezes(views: Mapping[str, Mapping[str, Any]]) -> str:
    """Number and longest of the freezes of each view that froze; empty if none did."""
    return "; ".join(
        f"{view.upper()} {entry['freezes']['count']}, longest {entry['freezes']['longest_s']:.1f} s"
        for view, entry in views.items()
        if entry["freezes"]["count"]
    )


def _quality(primary: Mapping[str, Any]) -> str:
    names = ("received", "delivered", "live")
    scores = [f"{name} {known(primary[f'{name}_ssim'], '{:.3f}')}" for name in names]
    task = [f"{name} {known(primary[f'task_{name}_ssim'], '{:.3f}')}" for name in names]
    at_task = "" if primary["task_received_ssim"] is None else f"; at the task {', '.join(task)}"
    compared = _percent(primary["sampled_fraction"], 0)
    return f"SSIM {', '.join(scores)}{at_task}; {compared} compared"


class _ViewsTable:
    """A row for each view; where the rows do not fit, each view's figures as a sentence."""

    def __init__(self, views: Mapping[str, Mapping[str, Any]], seen_elsewhere: bool) -> None:
        self._figures = {
            view.upper(): _view_figures(entry, seen_elsewhere) for view, entry in views.items()
        }

    def __rich_console__(self, console: RichConsole, options: ConsoleOptions) -> RenderResult:
        table = self._table()
        needed = Measurement.get(console, options.update(width=_ANY_WIDTH), table).maximum
        yield table if needed <= options.max_width else _named_rows(self._sentences())

    def _table(self) -> Table:
        table = Table(
            box=None, header_style="dim", padding=(0, 1), collapse_padding=True, pad_edge=False
        )
        table.add_column("View")
        for name, (unit, _) in next(iter(self._figures.values()), {}).items():
            heading = f"{name}\n{unit}" if unit else name
            table.add_column(heading, justify="right", no_wrap=True)
        for view, figures in self._figures.items():
            table.add_row(view, *(value for _, value in figures.values()))
        return table

    def _sentences(self) -> dict[str, str]:
        return {
            view: ", ".join(
                f"{name} {value} {unit}".rstrip() for name, (unit, value) in figures.items()
            )
            for view, figures in self._figures.items()
        }


def _view_figures(entry: Mapping[str, Any], seen_elsewhere: bool) -> dict[str, tuple[str, str]]:
    """Unit (where the value has none itself) and value of each figure of a view, by its name."""
    latency, freezes = entry["latency_ms"], entry["freezes"]
    shown = known(None if seen_elsewhere else entry["frames_shown"], "{:d}")
    return {
        "target": ("kbit/s", known(entry["target_kbps_mean"])),
        "sent": ("kbit/s", known(entry["sent_kbps_mean"])),
        "error": ("", _percent(entry["tracking_error"], 1)),
        "fps": ("", f"{known(entry['fps']['given'], '{:.1f}')}/{entry['fps']['asked']:g}"),
        "shown": ("", f"{shown}/{entry['frames_captured']}"),
        "p50": ("ms", known(latency["p50"])),
        "p95": ("ms", known(latency["p95"])),
        "freezes": ("", known(freezes["count"], "{:d}") + _seconds(freezes["total_s"])),
        "SSIM": ("", known(entry["received_ssim"], "{:.3f}")),
    }


def _percent(value: float | None, digits: int) -> str:
    return known(None if value is None else 100 * value, f"{{:.{digits}f}} %")


def _seconds(value: float | None) -> str:
    return f" ({value:.1f} s)" if value else ""
