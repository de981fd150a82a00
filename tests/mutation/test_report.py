from __future__ import annotations

import pytest

from tests.mutation.report import Mutant, changed_line, explained, render, statuses, totals, where

pytestmark = pytest.mark.untimed

RESULTS = """
    app.teleop.clutch.xǁClutchǁupdate__mutmut_12: killed
    app.teleop.clutch.x_is_fresh__mutmut_1: survived
    app.teleop.limits.xǁLimitsǁ__init____mutmut_2: caught by type check
"""
DIFF = """# app.x: survived
--- app/x.py
+++ app/x.py
@@ -1,3 +1,3 @@
 def is_fresh(stamp_ns):
-    return stamp_ns <= 3
+    return stamp_ns < 3
"""


def test_a_mutant_is_known_by_its_function_and_its_line_not_by_its_number() -> None:
    assert where("app.teleop.clutch.xǁClutchǁupdate__mutmut_12") == "clutch.Clutch.update"
    assert where("app.teleop.clutch.x__edge__mutmut_1") == "clutch._edge"
    assert where("app.teleop.limits.xǁLimitsǁ__init____mutmut_2") == "limits.Limits.__init__"
    assert changed_line(DIFF) == "return stamp_ns < 3"


def test_totals_count_every_end_of_every_module() -> None:
    assert totals(statuses(RESULTS)) == (
        "clutch: 2 mutants: 1 killed, 1 survived\nlimits: 1 mutants: 1 caught by type check"
    )


def test_a_survivor_is_explained_by_an_entry_with_its_function_and_its_line() -> None:
    survivor = Mutant("clutch.is_fresh", "return stamp_ns < 3")
    entry = "Never exactly 3:\n\n- `clutch.is_fresh`: `return stamp_ns < 3`\n"
    assert explained(entry) == {survivor}
    assert survivor not in explained(entry.replace("< 3", "< 4"))
    assert "clutch.is_fresh\n    return stamp_ns < 3" in render(statuses(RESULTS), [survivor])
