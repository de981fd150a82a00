#!/usr/bin/env bash
# Installs what is missing: Debian packages, a virtual environment, pinned Python packages.
set -euo pipefail
cd "$(dirname "$0")"

as_root() {
    if [ "$(id -u)" -eq 0 ]; then "$@"; else sudo "$@"; fi
}

install_debian_packages() {
    local wanted missing=()
    mapfile -t wanted < <(grep -vE '^\s*(#|$)' apt-packages.txt)
    for package in "${wanted[@]}"; do
        dpkg-query --show --showformat='${db:Status-Abbrev}' "$package" 2>/dev/null |
            grep -q '^ii' || missing+=("$package")
    done
    [ ${#missing[@]} -eq 0 ] && return
    echo "Debian packages to install: ${missing[*]}"
    as_root apt-get update --quiet=2
    as_root env DEBIAN_FRONTEND=noninteractive \
        apt-get install --yes --quiet=2 --no-install-recommends "${missing[@]}"
}

# PyGObject is built here, so Python's headers are needed as well.
USABLE='
import ensurepip, sys, sysconfig, venv
from pathlib import Path
headers = Path(sysconfig.get_path("include"), "Python.h")
sys.exit(sys.version_info < (3, 11) or not headers.exists())
'

find_python() {
    for candidate in python3.11 python3.12 python3.13 python3; do
        if command -v "$candidate" >/dev/null && "$candidate" -c "$USABLE" 2>/dev/null; then
            echo "$candidate"
            return
        fi
    done
    echo "TAMS needs Python 3.11 or later with venv and headers. Debian 12 and Ubuntu 24.04 have it;" \
        "elsewhere install python3.11, python3.11-venv and python3.11-dev (or a later version)." >&2
    exit 1
}

if command -v apt-get >/dev/null; then
    install_debian_packages
else
    echo "Not Debian or Ubuntu: install what apt-packages.txt lists by hand, then run this again." >&2
fi
python=$(find_python)
[ -x .venv/bin/python ] || "$python" -m venv .venv
install_pinned() {
    PATH="$PWD/.venv/bin:$PATH" .venv/bin/python -m pip install --quiet \
        --disable-pip-version-check --require-hashes "$@"
}

pinned() {  # one package of requirements.lock, with its hashes
    awk -v start="$1==" '/^[^ #]/ { wanted = index($0, start) == 1 } wanted' requirements.lock
}

# Of PyGObject and pycairo there are no wheels: they are built here, with what is pinned as well.
# Left to itself pip would fetch whatever versions of that are the newest. Nothing else is built.
echo "Installing the pinned Python packages into .venv"
install_pinned --only-binary :all: --requirement requirements-build.lock
for package in pycairo pygobject; do  # in this order: PyGObject is built with pycairo
    install_pinned --no-build-isolation --no-deps --requirement <(pinned "$package")
done
install_pinned --only-binary :all: --requirement requirements.lock
touch .venv/.ready
