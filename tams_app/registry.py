"""Objects that words of the configuration name: those of TAMS and of other distributions."""

from __future__ import annotations

import importlib.metadata
import pkgutil
from collections import Counter
from collections.abc import Iterator, Mapping, MutableMapping
from typing import Any, Generic, TypeVar, cast

from tams_app.errors import ConfigError, not_one_of

T = TypeVar("T")


class Registry(MutableMapping[str, T], Generic[T]):
    """Objects by name: built-in ones in the order of the reference, then other distributions'.

    A name stands for the object itself or for "module:object", which is imported when it is asked
    for: a session loads only what it uses. Other distributions enter theirs as entry points of
    `group`; a name that TAMS has already is never replaced by one of them.
    """

    def __init__(self, key: str, group: str, built_in: Mapping[str, T | str]) -> None:
        """Make a registry; nothing is imported or searched by this.

        Args:
            key: of the configuration, as errors name it.
            group: of the entry points.
            built_in: by name, the object or "module:object".
        """
        self.key, self.group = key, group
        self._known: dict[str, T | str] = dict(built_in)
        self._searched = False
        self._contested: dict[str, int] = {}  # by how many distributions

    def __getitem__(self, name: str) -> T:
        """Look an object up, and import it if need be.

        Args:
            name: a word of the configuration.

        Returns:
            The object.

        Raises:
            ConfigError: there is none of that name, it cannot be loaded, or several distributions
                have it.
        """
        if name not in self._known:
            self._search()
        if name not in self._known:
            raise ConfigError(f"{self.key}: {not_one_of(name, self)}")
        if times := self._contested.get(name):
            raise ConfigError(
                f"{self.key}: {times} installed distributions have a {name!r} ({self.group}): "
                "uninstall all but one"
            )
        found = self._known[name]
        if not isinstance(found, str):
            return found
        try:
            return cast(T, pkgutil.resolve_name(found))
        except Exception as error:  # whatever the import of a plug-in does
            raise ConfigError(f"{self.key}: {name!r} cannot be loaded: {error!r}") from error

    def get(self, name: str, default: Any = None) -> Any:
        """Look an object up that may be missing.

        Args:
            name: a word of the configuration.
            default: returned if there is none of that name.

        Returns:
            The object, or `default`.

        Raises:
            ConfigError: it cannot be loaded, or several distributions have it.
        """
        if name not in self:
            return default
        return self[name]

    def __setitem__(self, name: str, value: T | str) -> None:
        self._known[name] = value

    def __delitem__(self, name: str) -> None:
        del self._known[name]

    def __iter__(self) -> Iterator[str]:
        self._search()
        return iter(tuple(self._known))

    def __len__(self) -> int:
        self._search()
        return len(self._known)

    def __contains__(self, name: object) -> bool:
        if name not in self._known:
            self._search()
        return name in self._known

    def _search(self) -> None:
        """Look the installed distributions through, once."""
        if self._searched:
            return
        self._searched = True
        found = importlib.metadata.entry_points(group=self.group)
        counts = Counter(one.name for one in found)
        for name, times in sorted(counts.items()):
            if name in self._known:
                continue
            self._known[name] = found[name].value
            if times > 1:
                self._contested[name] = times
