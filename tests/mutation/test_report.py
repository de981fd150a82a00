from __future__ import annotations

from pathlib import Path

import pytest

from tests.mutation.__main__ import SURVIVORS, blobs_today, results_today
from tests.mutation.report import (
    ModuleResult,
    Mutant,
    blob_of,
    changed_line,
    counts_of,
    explained,
    module_path,
    mutated_modules,
    read,
    render,
    statuses,
    unfinished,
    untrue,
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


def test_no_result_is_of_other_code_than_todays() -> None:
    assert untrue(results_today(), blobs_today()) == []


def is_of(mutant: Mutant, path: str) -> bool:
    module = path.removesuffix(".py").replace("/", ".").removeprefix("tams_app.")
    return mutant.where.startswith(f"{module}.")


def test_every_survivor_of_a_result_is_explained_and_nothing_else_is() -> None:
    results = results_today()
    tried = {path: blob for path, blob in blobs_today().items() if path in results}
    known = explained(SURVIVORS.read_text("utf-8"))
    of_tried = {one for one in known if any(is_of(one, path) for path in tried)}
    assert unfinished(results, tried, of_tried) == []


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


def test_a_result_of_changed_code_and_one_of_no_module_are_untrue() -> None:
    gone = ModuleResult("a/gone.py", "3" * 40, "1 mutants: 1 killed")
    results = {"a/b.py": RESULT, "a/gone.py": gone}
    assert untrue(results, {"a/b.py": RESULT.blob, "a/gone.py": gone.blob}) == []
    assert untrue(results, {"a/b.py": "1" * 40}) == [
        "changed since its mutants were tried: a/b.py",
        "changed since its mutants were tried: a/gone.py",
    ]


def test_a_survivor_needs_an_explanation_an_explanation_a_survivor_and_a_module_a_result() -> None:
    blobs = {"a/b.py": RESULT.blob}
    entry = "Never exactly 3:\n\n- `teleop.clutch.is_fresh`: `return stamp_ns < 3`\n"
    assert unfinished({"a/b.py": RESULT}, blobs, explained(entry)) == []
    assert unfinished({"a/b.py": RESULT}, blobs, explained(entry.replace("< 3", "< 4"))) == [
        "not explained: teleop.clutch.is_fresh: return stamp_ns < 3",
        "explained, and no survivor: teleop.clutch.is_fresh: return stamp_ns < 4",
    ]
    assert unfinished({}, blobs, set()) == ["not tried: a/b.py"]


def test_modules_with_code_are_mutated_and_those_of_names_only_are_not(tmp_path: Path) -> None:
    (tmp_path / "one.py").write_text("def f(): pass\n")
    (tmp_path / "__init__.py").write_text('"""Names."""\n')
    assert mutated_modules(tmp_path, ["*.py"]) == ["one.py"]


def test_a_blob_is_named_as_git_names_it(tmp_path: Path) -> None:
    (tmp_path / "one").write_bytes(b"hello\n")
    assert blob_of(tmp_path / "one") == "ce013625030ba8dba906f756967f9e9ca394464a"
