from __future__ import annotations

import pytest

from tests.mutation.report import (
    ModuleResult,
    Mutant,
    unfinished,
)

pytestmark = pytest.mark.untimed

SURVIVOR = Mutant("teleop.clutch.is_fresh", "return stamp_ns < 3")
RESULT = ModuleResult("a/b.py", "0" * 40, "2 mutants: 1 killed, 1 survived", (SURVIVOR,))


def test_a_module_that_has_changed_since_its_mutants_were_tried_fails() -> None:
    results = {"a/b.py": RESULT}
    assert unfinished(results, {"a/b.py": "1" * 40}, results) == [
        "changed since its mutants were tried: a/b.py"
    ]


def test_a_new_survivor_and_a_module_that_was_not_tried_fail_a_known_survivor_does_not() -> None:
    blobs, results = {"a/b.py": RESULT.blob}, {"a/b.py": RESULT}
    assert unfinished(results, blobs, results) == []
    assert unfinished(results, blobs, {}) == [
        "survives now: teleop.clutch.is_fresh: return stamp_ns < 3",
    ]
    assert unfinished({}, blobs, results) == ["not tried: a/b.py"]
