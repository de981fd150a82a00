"""Results on the disk: whole files, and never outside the folder that they are meant for.

A folder with a log or a study may come from elsewhere. Whatever is written into one goes through
here: symbolic links in it are not followed, and names that its files hold are not taken as paths.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from tams_app.errors import ConfigError, LogError

_NAME = re.compile(r"[\w+-][\w+.-]{0,99}")


def is_plain_name(name: str) -> bool:
    """True if `name` can be a file's name in a folder: no path, not hidden, not too long."""
    return _NAME.fullmatch(name) is not None


def write_file(path: Path, content: str | bytes) -> None:
    """Write a whole file or none; errors as of `new_file`."""
    with new_file(path) as file:
        file.write(content.encode("utf-8") if isinstance(content, str) else content)


@contextmanager
def new_file(path: Path) -> Iterator[IO[bytes]]:
    """A file that takes the place of `path` in one step, once it is whole and on the disk.

    Readers and crashes see the old content or the new one. ConfigError if `path` is a symbolic
    link, LogError if the disk refuses.
    """
    _refuse_link(path)
    partial = path.with_name(f".{path.name}.{os.getpid()}.new")
    with _reported(path):
        partial.unlink(missing_ok=True)
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC | os.O_NOFOLLOW
        descriptor = os.open(partial, flags, 0o666)
        try:
            with open(descriptor, "wb") as file:
                yield file
                file.flush()
                os.fsync(descriptor)
            os.replace(partial, path)
        except BaseException:
            partial.unlink(missing_ok=True)
            raise
        _keep_names(path.parent)


def made_folder(folder: Path) -> Path:
    """`folder`, made if need be; LogError if the disk refuses."""
    with _reported(folder):
        folder.mkdir(parents=True, exist_ok=True)
    return folder


def refuse_existing(path: Path) -> None:
    """ConfigError if there is something at `path`: a result never takes its place."""
    if os.path.lexists(path):
        raise ConfigError(f"{path}: is there already: give another name")


def inner_folder(folder: Path, *names: str) -> Path:
    """A folder within `folder`, made if need be.

    ConfigError if one of `names` is no plain name or a symbolic link, LogError if the disk refuses.
    """
    for name in names:
        if not is_plain_name(name):
            raise ConfigError(f"{folder}: {name!r} cannot be the name of a folder")
        folder = folder / name
        _refuse_link(folder)
        made_folder(folder)
    return folder


def open_lock(path: Path) -> int:
    """The descriptor of a lock file, made if need be; errors as of `new_file`."""
    _refuse_link(path)
    with _reported(path):
        return os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o666)


def _refuse_link(path: Path) -> None:
    if path.is_symlink():
        raise ConfigError(
            f"{path}: is a symbolic link, and results are not written through one: remove it"
        )


def _keep_names(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def _reported(path: Path) -> Iterator[Any]:
    try:
        yield
    except OSError as error:
        raise LogError(f"{path}: cannot be written: {error.strerror or error}") from error
