"""The command that exports."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import pytest

from tams_app.cli import _main

Export: TypeAlias = Callable[..., tuple[int, str, str]]


@pytest.fixture
def export(capsys: pytest.CaptureFixture[str]) -> Export:
    """Exit code, output and errors of the command."""

    def run(*arguments: object, kind: str = "lerobot") -> tuple[int, str, str]:
        code = _main(["export", *map(str, arguments), "--format", kind])
        return code, *capsys.readouterr()

    return run
