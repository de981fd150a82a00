"""What the documents point at exists."""

import pkgutil
import re
from pathlib import Path

import pytest
import yaml

from tams_app.recording.topics import TOPICS

pytestmark = pytest.mark.untimed

ROOT = Path(__file__).parent.parent
MADE = {"CONFIGURATION.md", "LOG_FIELDS.md"}  # from the code, by `make docs`
NAMES = [
    "README.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "examples/README.md",
    *(
        str(path.relative_to(ROOT))
        for folder in ("docs", "config")
        for path in sorted((ROOT / folder).rglob("*.md"))
    ),
]
OURS = ("tams_app", "hw", "calibration", "config", "docs", "tests", "benchmarks", "examples")
CODE = re.compile(r"`((?:" + "|".join(OURS) + r")/[\w./*-]*)")
MODULE = re.compile(r"`((?:tams_app|hw|calibration)(?:\.[a-z]\w*)+)`")
LINK = re.compile(r"\]\(([^)\s]+)\)")
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)


def text(name):
    return (ROOT / name).read_text(encoding="utf-8")


def anchors(name):
    """The anchors of a document's headings, as GitHub makes them."""
    return {
        re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
        for heading in HEADING.findall(text(name))
    }


@pytest.mark.parametrize("name", NAMES)
def test_every_file_and_module_that_is_named_exists(name):
    for path in CODE.findall(text(name)):
        assert list(ROOT.glob(path.rstrip("/."))), path
    for module in MODULE.findall(text(name)):
        pkgutil.resolve_name(module)


@pytest.mark.parametrize("name", NAMES)
def test_every_module_that_is_to_be_run_exists(name):
    for module in re.findall(r"python -m ((?:benchmarks|tests|examples)[\w.]*\w)", text(name)):
        path = ROOT / module.replace(".", "/").replace("/NAME", "")
        assert path.with_suffix(".py").exists() or (path / "__main__.py").exists(), module


@pytest.mark.parametrize("name", NAMES)
def test_every_link_leads_somewhere(name):
    for link in LINK.findall(text(name)):
        if link.startswith("http"):
            continue
        path, _, anchor = link.partition("#")
        target = ((ROOT / name).parent / path).resolve() if path else ROOT / name
        assert target.exists(), link
        if anchor:
            assert anchor in anchors(target.relative_to(ROOT)), link


def test_every_document_has_its_place_in_the_navigation_of_the_site():
    def pages(entry):
        (found,) = entry.values()
        return [found] if isinstance(found, str) else [page for one in found for page in pages(one)]

    listed = [page for entry in yaml.safe_load(text("mkdocs.yml"))["nav"] for page in pages(entry)]
    shown = {name for name in NAMES if not name.startswith("config/") or "traces" in name}
    assert sorted(listed) == sorted(shown | {f"docs/{name}" for name in MADE})


def test_every_thread_is_named_as_in_the_code():
    section = text("docs/ARCHITECTURE.md").split("| thread | what it does |")[1].split("\n\n")[0]
    sources = [
        path.read_text(encoding="utf-8")
        for folder in ("tams_app", "hw")
        for path in (ROOT / folder).rglob("*.py")
    ]
    cells = [line.split("|")[1] for line in section.splitlines()[2:]]
    names = [name for cell in cells for name in re.findall(r"`([a-z-]+)(?:<view>)?`", cell)]
    assert len(names) > 10
    for name in names:
        quoted = f'"{name.removesuffix("-reports")}'  # the client adds the end
        assert any(quoted in source for source in sources), name


def test_every_topic_of_the_log_is_in_its_document():
    rows = re.findall(r"^\| `(/[\w/]+)` \|", text("docs/LOG.md"), re.MULTILINE)
    assert {topic.name for topic in TOPICS.values()} <= set(rows)


def test_every_citation_of_a_finding_has_its_section():
    sections = set(re.findall(r"^## (\d+)\.", text("docs/FINDINGS.md"), re.MULTILINE))
    for folder in ("tams_app", "hw", "calibration", "tests"):
        for path in (ROOT / folder).rglob("*.py"):
            cited = re.findall(r"FINDINGS\s+(\d+)", path.read_text(encoding="utf-8"))
            assert set(cited) <= sections, path


def test_the_container_is_made_of_files_and_targets_that_exist():
    lines = re.sub(r"\\\n", " ", text("Dockerfile")).splitlines()
    copied = [name for line in lines if line.startswith("COPY ") for name in line.split()[1:-1]]
    assert {"setup.sh", "apt-packages.txt", "."} <= set(copied)
    for name in copied:
        assert (ROOT / name).exists(), name
    makefile = text("Makefile")
    targets = [
        *re.findall(r"^RUN make (\w+)$", "\n".join(lines), re.MULTILINE),
        *re.findall(
            r'^CMD \["make", "(\w+)", "ARGS=--headless"\]$', "\n".join(lines), re.MULTILINE
        ),
    ]
    assert targets == ["setup", "run"]
    for target in targets:
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
    # set-up is not repeated at the start: what it is made from is copied before it
    ready = re.search(r"^\$\(READY\): (.+)$", makefile, re.MULTILINE)
    assert ready
    assert set(ready.group(1).split()) <= set(copied)
