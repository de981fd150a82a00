"""What a session says on its terminal, without when."""

import re

_TIME = re.compile(r"^\d+:\d\d\.\d  ")


def spoken(line: str) -> str:
    """The sentence of a line of output."""
    return _TIME.sub("", line)
