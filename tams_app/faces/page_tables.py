"""The words and figures that the page in a browser shows, as one table; pure.

The page has no words of its own for states, reasons, hands and figures: it gets these, and fills
them in as `banner`, `shown` and `episodes` do.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

from tams_app import __version__, palette
from tams_app.config import Config
from tams_app.faces import banner, episodes, shown, silence
from tams_app.faces.messages import Opening, ShownWorkspace
from tams_app.faces.window.keyboard import key_help
from tams_app.link.messages import PROTOCOL
from tams_app.records import EpisodeRequest
from tams_app.teleop.hands import HANDS
from tams_app.teleop.reasons import GO_ON, Reason
from tams_app.video.core.stages import REMEDIES, STAGES, stage_words

_NOWHERE = ShownWorkspace((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0)


def page_tables(config: Config) -> dict[str, Any]:
    """All of it, ready for JSON; of `config` come the speeds of the hand that keys move."""
    looks = banner.LOOKS | {"": banner.look_of(""), "ended": banner.ENDED}
    return {
        "version": __version__,
        "protocol": PROTOCOL,
        "looks": {state: asdict(look) for state, look in looks.items()},
        "quiet": banner.QUIET,
        "starting": banner.STARTING,
        "phrases": banner.PHRASES,
        "hands": {name: asdict(replace(one, controls=())) for name, one in HANDS.items()},
        "keys": {name: _keys(name) for name in HANDS},
        "reasons": {one.label: [one.lasting, one.left] for one in Reason},
        "goOn": GO_ON,
        "uplink": shown.UPLINK,
        "slowest": shown.SLOWEST,
        "toTheUplink": shown.TO_THE_UPLINK,
        "notableMs": shown.NOTABLE_MS,
        "remedies": REMEDIES,
        "otherRemedy": shown.OTHER_REMEDY,
        "stages": {stage: stage_words(stage) for stage in (*STAGES, "")},
        "headings": shown.HEADINGS,
        "titles": shown.TITLES,
        "meanings": shown.MEANINGS,
        "hand": shown.HAND,
        "hottest": shown.HOTTEST,
        "episodes": episodes.WORDS,
        "episodeKeys": episodes.KEYS_NOW,
        "askedWithinS": episodes.ASKED_WITHIN_S,
        "requests": [one.name.lower() for one in EpisodeRequest],
        "liveMs": silence.LIVE_NS // 1_000_000,
        "oldMs": config.freshness.video_slow_ms,
        "viewColours": palette.VIEW_COLOURS,
        "desk": config.controller.desk.model_dump(),
    }


def _keys(hand: str) -> list[tuple[str, str]]:
    """All keys that mean something to the page, and the controls of this hand."""
    opening = Opening(("",), 0, 0, _NOWHERE, False, hand, 0.0, has_episodes=True)
    return [row for row in key_help(opening) if row[0] != "F11"]
