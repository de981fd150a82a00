"""docs/TROUBLESHOOTING.md quotes what the code prints, word for word."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

pytestmark = pytest.mark.untimed

ROOT = Path(__file__).parent.parent
SHORTEST = 3  # a piece of a quotation that is looked for
ROW = re.compile(r"^\| (?!---)(.+?) \|", re.MULTILINE)
HEADS = {"what is printed", "what is seen or printed", "reason"}
NOT_PRINTED = {"DISPLAY", "doctor", "log list", "operate", "--headless", "see", "MISSING"}


def printed() -> str:
    """Every text in the code, and the set-up's."""
    texts = [(ROOT / "setup.sh").read_text(encoding="utf-8")]
    for folder in ("tams_app", "hw", "calibration"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            texts += [
                node.value
                for node in ast.walk(tree)
                if isinstance(node, ast.Constant) and isinstance(node.value, str)
            ]
    return "\n".join(texts)


def quoted() -> list[str]:
    text = (ROOT / "docs" / "TROUBLESHOOTING.md").read_text(encoding="utf-8")
    cells = [cell for cell in ROW.findall(text) if cell not in HEADS]
    return [one for cell in cells for one in re.findall(r"`([^`]+)`", cell)]


def test_every_sentence_that_is_quoted_is_printed_by_the_code() -> None:
    texts, sentences = printed(), [one for one in quoted() if one not in NOT_PRINTED]
    assert len(sentences) > 60
    for sentence in sentences:
        for piece in re.split("…", sentence):
            if len(piece := piece.strip(" ,;")) >= SHORTEST:
                assert piece in texts, f"{piece!r} of {sentence!r}"


def test_every_command_that_is_named_is_one() -> None:
    text = (ROOT / "docs" / "TROUBLESHOOTING.md").read_text(encoding="utf-8")
    source = (ROOT / "tams_app" / "cli.py").read_text(encoding="utf-8")
    source += "".join(
        path.read_text(encoding="utf-8") for path in (ROOT / "tams_app/console").glob("*.py")
    )
    named = set(re.findall(r"run_tams\.py ([a-z]+)", text))
    assert len(named) > 5
    for name in named:
        assert re.search(rf'def {name}\(|"{name}"|name="{name}"', source), name
