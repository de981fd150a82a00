"""docs/SAFETY.md says what the code does, and names tests that exist."""

import ast
import re
from pathlib import Path

import pytest

from tams_app.teleop import safety
from tams_app.teleop.safety import Reason
from tests.teleop.arming_table import ARROWS

pytestmark = pytest.mark.untimed

ROOT = Path(__file__).parent.parent
DOCUMENT = (ROOT / "docs" / "SAFETY.md").read_text(encoding="utf-8")
NAMED = sorted(set(re.findall(r"`(tests/[\w/]+\.py(?:::\w+)?)`", DOCUMENT)))


def section(title):
    """The text of one section, without those that follow on its level."""
    _, _, rest = DOCUMENT.partition(f"\n## {title}\n")
    assert rest, f"no section {title}"
    return rest.split("\n## ")[0]


def tables(text):
    """Every table of `text` as rows of stripped cells, without its rule."""
    found, rows = [], []
    for line in [*text.splitlines(), ""]:
        if line.startswith("|"):
            cells = [cell.strip() for cell in line.strip("|").split("|")]
            if not all(set(cell) <= {"-"} for cell in cells):
                rows.append(cells)
        elif rows:
            found.append(rows)
            rows = []
    return found


@pytest.mark.parametrize("name", NAMED)
def test_every_test_that_is_named_exists(name):
    path, _, function = name.partition("::")
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    assert function in functions or not function


def test_the_fault_matrix_is_named_whole():
    found = {str(path.relative_to(ROOT)) for path in ROOT.glob("tests/faults/test_*.py")}
    assert found == {name for name in NAMED if re.fullmatch(r"tests/faults/\w+\.py", name)}


def test_the_arrows_are_those_of_the_code():
    header, *rows = tables(section("The arming table"))[0]
    assert header == ["no.", "from", "event", "to"]
    assert [row[0] for row in rows] == [str(k + 1) for k in range(len(ARROWS))]
    # The tests of the state machine hold ARROWS against what it does (tests/teleop/test_safety.py).
    assert [tuple(row[1:]) for row in rows] == [
        (start.name if start else "any", event, end.name) for start, event, end in ARROWS
    ]
    _, *in_code = tables(safety.__doc__)[0]
    told = [(start, event, end.removesuffix("(reason)")) for start, event, end in in_code]
    assert told == [tuple(row[1:]) for row in rows]


def test_every_reason_is_in_the_table_with_its_severity():
    _, *rows = tables(section("Every reason"))[0]
    assert [row[:2] for row in rows] == [
        [reason.label, "fault" if reason.is_fault else "hold"] for reason in Reason
    ]
