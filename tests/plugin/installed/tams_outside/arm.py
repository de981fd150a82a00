"""An arm: the Lite 6's maker sells it under another name, with a shorter reach in its leaflet."""

from dataclasses import replace

from hw.lite6.commands import LIMITS
from hw.lite6.kind import Lite6Kind


class Outside(Lite6Kind):
    title = "Outside"
    limits = replace(LIMITS, reach_mm=435.0)
    rig = ""


KIND = Outside()
