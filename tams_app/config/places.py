"""Places of TAMS's configuration files, in a checkout and where it is installed."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]


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
