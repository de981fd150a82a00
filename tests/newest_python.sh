#!/usr/bin/env bash
# Prints the newest Python of this machine that TAMS was tried with: 3.13, else 3.12; pyenv's count.
set -u
USABLE='
import ensurepip, sys, sysconfig
from pathlib import Path
if Path(sysconfig.get_path("include"), "Python.h").exists():  # PyGObject is built
    print(sys.executable)
'
for version in 3.13 3.12; do
    for python in "python$version" "${PYENV_ROOT:-$HOME/.pyenv}/versions/$version".*/bin/python; do
        if found=$("$python" -c "$USABLE" 2>/dev/null) && [ -n "$found" ]; then
            echo "$found"
            exit 0
        fi
    done
done
echo "No Python 3.13 or 3.12 with its headers was found. Debian 13 and Ubuntu 24.04 have one" \
    "(python3, python3-venv, python3-dev); elsewhere: pyenv install 3.13." >&2
exit 1
