from __future__ import annotations

from pathlib import Path

import pytest

from tests.mutation.__main__ import blobs_today, results_today
from tests.mutation.report import (
    ModuleResult,
    Mutant,
    blob_of,
    changed_line,
    counts_of,
    module_path,
    mutated_modules,
    read,
    render,
    statuses,
    unfinished,
    where,
)

pytestmark = pytest.mark.untimed

RESULTS = """
    tams_app.teleop.clutch.xǁClutchǁupdate__mutmut_12: killed
    tams_app.teleop.clutch.x_is_fresh__mutmut_1: survived
    hw.link.controller.xǁLinkǁ__init____mutmut_2: caught by type check
"""
DIFF = """# app.x: survived
--- app/x.py
+++ app/x.py
@@ -1,3 +1,3 @@
 def is_fresh(stamp_ns):
-    return stamp_ns <= 3
+    return stamp_ns < 3
"""
SURVIVOR = Mutant("teleop.clutch.is_fresh", "return stamp_ns < 3")
RESULT = ModuleResult("a/b.py", "0" * 40, "2 mutants: 1 killed, 1 survived", (SURVIVOR,))


CARRY_SAFETY = {
    "hw/desk/keyboard.py",
    "hw/guard/process.py",
    "hw/lite6/report_watch.py",
    "hw/lite6/sender.py",
    "hw/lite6/stop_channel.py",
    "tams_app/link/ends.py",
    "tams_app/link/messages.py",
    "tams_app/faces/window/keyboard.py",
    "tams_app/policy/weights.py",
    "tams_app/robot/arm_gate.py",
    "tams_app/robot/control.py",
    "tams_app/robot/guarding.py",
    "tams_app/robot/homing.py",
    "tams_app/robot/linked_hand.py",
    "tams_app/station/seat.py",
    "tams_app/station/fresh_video.py",
    "tams_app/teleop/drive.py",
    "tams_app/teleop/limits.py",
}


def test_what_carries_safety_is_mutated_and_no_result_is_of_anything_else() -> None:
    assert blobs_today().keys() >= CARRY_SAFETY
    assert results_today().keys() <= blobs_today().keys()


def test_a_mutant_is_known_by_its_function_and_its_line_not_by_its_number() -> None:
    names = list(statuses(RESULTS))
    assert [where(name) for name in names] == [
        "teleop.clutch.Clutch.update",
        "teleop.clutch.is_fresh",
        "hw.link.controller.Link.__init__",
    ]
    assert module_path(names[2]) == "hw/link/controller.py"
    assert changed_line(DIFF) == "return stamp_ns < 3"


def test_a_mutant_that_only_takes_a_line_away_is_known_by_that_line() -> None:
    without = DIFF.replace("+    return stamp_ns < 3\n", "")
    assert changed_line(without) == "without return stamp_ns <= 3"


def test_every_end_is_counted() -> None:
    ends = statuses(RESULTS).values()
    assert counts_of(ends) == "3 mutants: 1 killed, 1 survived, 1 caught by type check"
    assert counts_of(()) == "0 mutants"


def test_results_are_read_as_they_were_written() -> None:
    other = ModuleResult("a/c.py", "f" * 40, "1 mutants: 1 killed")
    empty = ModuleResult("a/d.py", "a" * 40, counts_of(()))
    results = {"a/b.py": RESULT, "a/c.py": other, "a/d.py": empty}
    assert read(render(results)) == results


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


def test_modules_with_code_are_mutated_and_those_of_names_only_are_not(tmp_path: Path) -> None:
    (tmp_path / "one.py").write_text("def f(): pass\n")
    (tmp_path / "__init__.py").write_text('"""Names."""\n')
    assert mutated_modules(tmp_path, ["*.py"]) == ["one.py"]


def test_a_blob_is_named_as_git_names_it(tmp_path: Path) -> None:
    (tmp_path / "one").write_bytes(b"hello\n")
    assert blob_of(tmp_path / "one") == "ce013625030ba8dba906f756967f9e9ca394464a"
