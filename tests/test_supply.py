"""What is installed and run from elsewhere is pinned, to the bit."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

from tams_app.config import CONFIG_DIRECTORY

pytestmark = pytest.mark.untimed

ROOT = CONFIG_DIRECTORY.parent
LOCKS = sorted(ROOT.glob("requirements*.lock"))
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def locked(lock: Path) -> dict[str, list[str]]:
    """The lines after each requirement of a lock."""
    found: dict[str, list[str]] = {}
    for line in lock.read_text(encoding="utf-8").splitlines():
        if line and not line.startswith((" ", "#")):
            found[line] = []
        elif found:
            found[[*found][-1]].append(line.strip())
    return found


@pytest.mark.parametrize("lock", LOCKS, ids=lambda lock: lock.name)
def test_every_requirement_has_one_version_and_hashes(lock: Path) -> None:
    requirements = locked(lock)
    assert requirements
    for line, details in requirements.items():
        requirement = Requirement(line.removesuffix("\\").strip())
        assert [one.operator for one in requirement.specifier] == ["=="]
        assert any(one.startswith("--hash=sha256:") for one in details), line
    assert "://" not in lock.read_text(encoding="utf-8")


def test_every_python_gets_the_same_versions_of_what_tams_computes_with() -> None:
    names = [
        re.split("[=; ]", line)[0]
        for lock in ("requirements.lock", "requirements-extras.lock")
        for line in locked(ROOT / lock)
    ]
    twice = {name for name in names if names.count(name) > 1}
    assert not twice


def test_each_group_of_dependencies_has_its_lock() -> None:
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text())["dependency-groups"]
    for group, wanted in groups.items():
        pinned = {re.split("[=; ]", one)[0] for one in locked(ROOT / f"requirements-{group}.lock")}
        assert {Requirement(one).name.lower() for one in wanted} <= pinned


def test_what_npm_installs_has_one_version_and_a_hash_and_no_address() -> None:
    lock = json.loads((ROOT / "tests" / "page" / "package-lock.json").read_text())
    wanted = lock["packages"].pop("")["devDependencies"]
    assert {f"node_modules/{name}" for name in wanted} <= lock["packages"].keys()
    assert all(re.fullmatch(r"[\d.]+", version) for version in wanted.values())
    for package in lock["packages"].values():
        assert package["integrity"].startswith("sha512-")
        assert "resolved" not in package


def test_setup_builds_nothing_with_what_is_not_pinned() -> None:
    setup = (ROOT / "setup.sh").read_text(encoding="utf-8")
    commands = re.sub(r"\\\n *", "", setup)
    (pip,) = re.findall(r"-m pip install.*", commands)
    assert "--require-hashes" in pip
    calls = re.findall(r"^ *install_pinned (?!\().*", commands, re.MULTILINE)
    assert len(calls) == 4
    for call in calls:
        assert "--only-binary :all:" in call or "--no-build-isolation --no-deps" in call


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda workflow: workflow.name)
def test_actions_are_named_by_commit_and_say_of_which_version(workflow: Path) -> None:
    text = workflow.read_text(encoding="utf-8")
    used = re.findall(r"uses: (.*)", text)
    assert used
    for one in used:
        assert re.fullmatch(r"[\w/-]+@[0-9a-f]{40}  # v\d+\.\d+\.\d+", one)


def test_known_vulnerabilities_are_looked_for_where_there_is_a_network() -> None:
    (jobs,) = [yaml.safe_load(workflow.read_text())["jobs"] for workflow in WORKFLOWS]
    script = "\n".join(step.get("run", "") for step in jobs["audit"]["steps"])
    for lock in LOCKS:
        assert lock.name in script
    assert "--require-hashes" in script
    assert "pip-audit" not in (ROOT / ".ci" / "run").read_text()
