"""A YAML file of any origin as keys and values, bounded in time and memory; where ours are."""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path
from typing import Any

import yaml

from tams_app.errors import ConfigError

LONGEST_FILE_BYTES = 256_000
DEEPEST = 40
LONGEST_NUMBER = 100  # characters
MOST_REPEATED = 10_000  # values that all aliases of a file together stand for
_TEXT_OF_A_VALUE = 64  # characters; longer text counts as more than one value
_INTEGERS = range(-(2**63), 2**63)  # what a log can hold
_PACKAGE = Path(__file__).resolve().parents[1]


class _RefusedError(yaml.YAMLError):
    """Valid YAML that is not read; its text says in which line and why."""

    def __init__(self, where: Any, reason: str) -> None:
        """`where`: a node or an event of YAML's."""
        super().__init__(f"line {where.start_mark.line + 1}: {reason}")


class _BoundedLoader(yaml.SafeLoader):
    """Refuses what YAML's own loader accepts at any cost, or settles silently.

    Of a key given twice the last would win. Aliases of lists of aliases stand for as many values
    as one likes. A number of many digits takes time that grows with their square.
    """

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._sizes: dict[yaml.Node, int] = {}  # of whole nodes, with what their aliases stand for
        self._open: list[int] = []  # sizes so far of the nodes that this one is part of
        self._repeated = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]
        alias = isinstance(event, yaml.AliasEvent)
        if len(self._open) >= DEEPEST:
            raise _RefusedError(event, f"is nested more than {DEEPEST} deep")
        if not alias:
            self._open.append(1)
        node = super().compose_node(parent, index)
        if node is None:
            return None
        if alias:
            size = self._repeat(event, node)
        else:
            long = node.value if isinstance(node, yaml.ScalarNode) else ""
            size = self._sizes[node] = self._open.pop() + len(long) // _TEXT_OF_A_VALUE
        if self._open:
            self._open[-1] += size
        return node

    def _repeat(self, event: Any, node: yaml.Node) -> int:
        if node not in self._sizes:
            raise _RefusedError(event, "an alias is part of what it stands for")
        self._repeated += self._sizes[node]
        if self._repeated > MOST_REPEATED:
            raise _RefusedError(
                event, f"aliases stand for more than {MOST_REPEATED} values: write them out"
            )
        return self._sizes[node]

    def compose_mapping_node(self, anchor: dict[Any, yaml.Node]) -> yaml.MappingNode:
        node = super().compose_mapping_node(anchor)
        lines: dict[tuple[str, str], int] = {}
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue
            line, name = key.start_mark.line + 1, (key.tag, key.value)
            if name in lines:
                raise _RefusedError(
                    key, f"{key.value}: is already given in line {lines[name]}; keep one"
                )
            lines[name] = line
        return node

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """The value of a node; PyYAML raises anything for text that does not suit its tag."""
        try:
            return super().construct_object(node, deep)
        except (AttributeError, LookupError, TypeError, ValueError, OverflowError) as error:
            tag = node.tag.removeprefix("tag:yaml.org,2002:")
            raise _RefusedError(node, f"is not a value of the kind {tag}") from error

    def construct_number(self, node: yaml.ScalarNode) -> int | float:
        """An integer or a fraction."""
        if len(node.value) > LONGEST_NUMBER:
            raise _RefusedError(node, f"a number has more than {LONGEST_NUMBER} characters")
        if _OLD_NUMBER.match(node.value):
            raise _RefusedError(
                node,
                f"{node.value} is one number in YAML 1.1 and another, or text, in 1.2: write a "
                "number without a colon or leading zero, text in quotes",
            )
        if node.tag.endswith("float"):
            return float(self.construct_yaml_float(node))
        number = int(self.construct_yaml_int(node))
        if number not in _INTEGERS:
            raise _RefusedError(node, "an integer has more than 64 bits")
        return number


# Base 60 (12:30 is 750) and base 8 (010 is 8), which serial numbers and times look like.
_OLD_NUMBER = re.compile(r"[-+]?0[0-9_]|[^:]*:")
# As YAML 1.2 has it: `on`, `off`, `yes` and `no` are words, which several keys take. A key that
# wants a truth value takes these words as well.
_BOOL = "tag:yaml.org,2002:bool"
_BoundedLoader.yaml_implicit_resolvers = {
    first: [one for one in resolvers if one[0] != _BOOL]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_BoundedLoader.add_implicit_resolver(_BOOL, re.compile(r"(?:true|false)\Z", re.I), list("tTfF"))

for _tag in ("int", "float"):
    _BoundedLoader.add_constructor(f"tag:yaml.org,2002:{_tag}", _BoundedLoader.construct_number)


def read_yaml(path: Path) -> dict[str, Any]:
    """The keys and values of a YAML file; ConfigError if it holds anything else."""
    try:
        content = yaml.load(_text(path), Loader=_BoundedLoader)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except _RefusedError as error:
        raise ConfigError(f"{path}: {error}") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        line = " ".join(str(error).split())
        raise ConfigError(f"{path}: is not valid YAML: {line}") from error
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: must hold keys and values")
    return content


def _text(path: Path) -> str:
    """The file's text; a pipe or device, which may never end, is not opened to wait for it."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    with open(descriptor, "rb") as file:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise ConfigError(f"{path}: cannot be read: is not a regular file")
        content = file.read(LONGEST_FILE_BYTES + 1)
    if len(content) > LONGEST_FILE_BYTES:
        raise ConfigError(f"{path}: is larger than {LONGEST_FILE_BYTES // 1000} kB")
    return content.decode("utf-8")


def find_config_directory(package: Path) -> Path:
    """`config/` of the checkout that the folder `package` is in, else the installed package data.

    A folder `config` beside an installed package may be of another program: run_tams.py knows.
    """
    checkout = package.parent
    if (checkout / "run_tams.py").is_file() and (checkout / "config").is_dir():
        return checkout / "config"
    return package / "default_config"


def writable_directory(config_path: Path, installed: Path = _PACKAGE / "default_config") -> Path:
    """The folder of files that belong to a configuration file: its own.

    For an installed one, which is not the user's to change, it is `config/` in the working
    directory.
    """
    return Path("config") if config_path.parent == installed else config_path.parent


CONFIG_DIRECTORY = find_config_directory(_PACKAGE)
DEFAULT_CONFIG = CONFIG_DIRECTORY / "tams.yaml"
