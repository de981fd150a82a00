#!/usr/bin/env bash
# Prints the newest Python of this machine that TAMS was tried with: 3.13, else 3.12; pyenv's count.
set -u
for version in 3.13 3.12; do
    for python in "python$version" "${PYENV_ROOT:-$HOME/.pyenv}/versions/$version".*/bin/python; do
        found=$("$python" -c 'import ensurepip, sys; print(sys.executable)' 2>/dev/null) || continue
        echo "$found"
        exit 0
    done
done
echo "No Python 3.13 or 3.12 was found. Debian 13 and Ubuntu 24.04 have one (python3, python3-venv," \
    "python3-dev); elsewhere: pyenv install 3.13." >&2
exit 1
