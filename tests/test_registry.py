"""Words of the configuration, and what they stand for."""

from __future__ import annotations

from pathlib import Path

import pytest

from tams_app.errors import ConfigError
from tams_app.registry import Registry

pytestmark = pytest.mark.untimed


def registry(group: str = "tams.none") -> Registry[object]:
    return Registry("key", group, {"pi": "math:pi", "own": 1.0, "gone": "math:tau2", "bad": "no:x"})


def install(site: Path, name: str, *lines: str) -> None:
    """A distribution with these entry points."""
    info = site / f"{name}-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n")
    (info / "entry_points.txt").write_text("\n".join(("[tams.things]", *lines)))


def test_a_name_stands_for_an_object_or_for_where_it_is() -> None:
    known = registry()
    assert known["pi"] == pytest.approx(3.14159, rel=1e-5)
    assert known["own"] == 1.0
    assert list(known) == ["pi", "own", "gone", "bad"]


def test_a_name_that_stands_for_nothing_is_one_sentence_with_those_there_are() -> None:
    with pytest.raises(ConfigError, match="key: 'e' is not one of pi, own, gone, bad"):
        registry()["e"]
    assert registry().get("e", 2) == 2
    assert registry().get("own") == 1.0


@pytest.mark.parametrize("name", ["gone", "bad"])
def test_what_cannot_be_loaded_is_one_sentence(name: str) -> None:
    with pytest.raises(ConfigError, match=f"key: '{name}' cannot be loaded: "):
        registry()[name]


def test_another_distribution_adds_names_and_replaces_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(tmp_path, "other", "e = math:e", "own = math:e")
    monkeypatch.syspath_prepend(tmp_path)
    known = registry("tams.things")
    assert "e" in known
    assert known["e"] == pytest.approx(2.71828, rel=1e-5)
    assert known["own"] == 1.0
    assert list(known) == ["pi", "own", "gone", "bad", "e"]
    assert len(known) == 5


def test_two_distributions_with_one_name_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(tmp_path, "one", "e = math:e")
    install(tmp_path, "two", "e = math:pi")
    monkeypatch.syspath_prepend(tmp_path)
    assert registry("tams.things")["pi"]  # of TAMS: no reason to look
    with pytest.raises(ConfigError, match=r"2 installed distributions have a 'e' \(tams.things\)"):
        registry("tams.things")["e"]
    assert list(registry("tams.things"))[-1] == "e"  # the others are not kept from their work
