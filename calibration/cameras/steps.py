"""The steps of the wizard by name, and which of them are done."""

from __future__ import annotations

from tams_app.errors import ConfigError

WHICH, FOCUS, EXPOSURE, RATE = "which", "focus", "exposure", "rate"
LATENCY, CLOCKS, INTRINSICS = "latency", "clocks", "intrinsics"
ALWAYS = (WHICH, FOCUS, EXPOSURE, RATE)
OFFERED = {
    LATENCY: "Measure the latency, with a screen that the cameras can be pointed at?",
    CLOCKS: "Compare the cameras' clocks by a light? Have its switch at hand, it begins at once.",
    INTRINSICS: "Measure the lenses, with a printed board?",
}


def chosen_steps(only: str) -> tuple[str, ...]:
    """From `which,focus`; none given are those that always are. ConfigError lists the names."""
    if not only:
        return ALWAYS
    names = tuple(name.strip() for name in only.split(","))
    known = (*ALWAYS, *OFFERED)
    for name in names:
        if name not in known:
            raise ConfigError(f"--only: {name!r} is none of {', '.join(known)}")
    return names
