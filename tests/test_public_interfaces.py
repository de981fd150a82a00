"""The names of docs/API.md exist, and their docstrings have what a plug-in's author needs."""

import ast
import inspect
import pkgutil
import re
from itertools import pairwise
from pathlib import Path

import pytest

from tams_app.registry import Registry

pytestmark = pytest.mark.untimed

ROOT = Path(__file__).parent.parent
ENTRY = re.compile(r"^- \[`([\w.]+)`\]\(\.\./(\S+\.py)\)", re.MULTILINE)
LISTED = dict(ENTRY.findall((ROOT / "docs/API.md").read_text(encoding="utf-8")))
# Data: their fields are described as fields, and their few methods are conversions.
DATA = ("tams_app.records.", "tams_app.config.", "tams_app.recording.")


def described(name):
    """Each function and class below a name of the list, with its own name for messages."""
    found = pkgutil.resolve_name(name)
    yield name, found
    if inspect.isclass(found) and not name.startswith(DATA):
        for member, raw in vars(found).items():
            own = raw.__func__ if isinstance(raw, (staticmethod, classmethod)) else raw
            is_public = not member.startswith("_")
            is_written = member == "__init__" and own.__doc__ is not None  # not a dataclass's
            is_called = inspect.isfunction(own) or isinstance(own, property)
            if is_called and (is_public or is_written):
                yield f"{name}.{member}", own


def has_text_below(file, name):
    """Whether a string follows the assignment of a module's variable, as its docstring."""
    body = ast.parse((ROOT / file).read_text(encoding="utf-8")).body
    for statement, below in pairwise(body):
        if isinstance(statement, ast.AnnAssign) and ast.unparse(statement.target) == name:
            return isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant)
    return False


def missing(function, doc):
    """Sections and arguments that the docstring of a function lacks."""
    signature = inspect.signature(function)
    arguments = [name for name in signature.parameters if name not in ("self", "cls")]
    wanted = [f"    {name.lstrip('*')}: " for name in arguments]
    if arguments:
        wanted.append("Args:\n")
    if arguments and signature.return_annotation not in (None, "None"):
        wanted.append("Returns:\n")
    return [one for one in wanted if one not in doc]


def test_the_list_has_the_interfaces_that_entry_points_are_made_of():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    files = re.findall(r"^\| `tams\.\w+` \|.*\| `(\S+\.py)` \|$", text, re.MULTILINE)
    assert len(files) == 8
    for file in files:
        module = file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        for name, found in vars(pkgutil.resolve_name(module)).items():
            is_own = inspect.isclass(found) and found.__module__ == module
            if not name.startswith("_") and (is_own or isinstance(found, Registry)):
                assert f"{module}.{name}" in LISTED


@pytest.mark.parametrize("name", LISTED)
def test_every_name_of_the_list_exists_in_the_file_that_it_leads_to(name):
    found = pkgutil.resolve_name(name)
    text = (ROOT / LISTED[name]).read_text(encoding="utf-8")
    last = name.rpartition(".")[2]
    assert re.search(rf"^(class {last}\b|def {last}\(|{last}\b.* = )", text, re.MULTILINE)
    assert found is not None


@pytest.mark.parametrize("name", LISTED)
def test_every_public_function_describes_its_arguments_and_its_result(name):
    for full_name, found in described(name):
        if not (inspect.isclass(found) or inspect.isfunction(found) or isinstance(found, property)):
            assert has_text_below(LISTED[name], name.rpartition(".")[2]), full_name
            continue
        doc = inspect.getdoc(found)
        assert doc, full_name
        if inspect.isfunction(found) and not name.startswith(DATA):
            assert not missing(found, doc), full_name
