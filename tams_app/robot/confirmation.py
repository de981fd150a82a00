"""The age up to which a confirmation counts: one limit for window, terminal and link."""

from tams_app.units import NS_PER_S

CONFIRMED_AGO_NS = 2 * NS_PER_S  # one that may be older is not acted on
TOO_LONG_AGO = "not confirmed: the operator did so too long ago"
