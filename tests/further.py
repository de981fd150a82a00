"""Cases of a promise that `make verify` adds to those of `make test`."""

import pytest


def further(*values: object) -> list[object]:
    """Further values of a `parametrize`; a tuple stands for several names."""
    return [
        pytest.param(*(value if isinstance(value, tuple) else (value,)), marks=pytest.mark.verify)
        for value in values
    ]
