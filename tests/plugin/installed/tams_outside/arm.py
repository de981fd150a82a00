"""An arm: the Lite 6's maker sells it under another name, with a longer reach in its leaflet."""

from dataclasses import replace

from hw.lite6.commands import LIMITS
from hw.lite6.kind import Lite6Kind


class Outside(Lite6Kind):
    title = "Outside"
    limits = replace(LIMITS, tcp_speed_mm_s=300.0)
    rig = ""


KIND = Outside()
