#!/usr/bin/env bash
# Installs what is missing: Debian packages, a virtual environment, pinned Python packages.
#   ./setup.sh [ENVIRONMENT [PYTHON]]      .venv, with the oldest supported Python found
#   ./setup.sh --extras [ENVIRONMENT]      then the optional packages, and what checks and tests need
set -euo pipefail
cd "$(dirname "$0")"
extras=
if [ "${1:-}" = --extras ]; then extras=yes; shift; fi
environment=${1:-.venv}
python=${2:-}
log=build/setup.log
mkdir -p build
: > "$log"

as_root() {
    if [ "$(id -u)" -eq 0 ]; then "$@"; else sudo "$@"; fi
}

# Runs a command and keeps its output in the log, whose end is shown if the command fails. A
# terminal shows the latest line that matches a pattern: how many came so far, and its groups.
stage() {
    local title=$1 pattern=$2 line count=0
    shift 2
    echo "$title"
    if "$@" 2>&1 | while IFS= read -r line; do
        printf '%s\n' "$line" >> "$log"
        if [[ -t 1 && $line =~ $pattern ]]; then
            count=$((count + 1))
            line="  $count: ${BASH_REMATCH[*]:1}"
            printf '\r\033[K%s' "${line:0:100}"
        fi
    done; then
        if [ -t 1 ]; then printf '\r\033[K'; fi
    else
        printf '\n%s\n' "$(tail -n 25 "$log")" >&2
        echo "Set-up failed at \"$title\"; all of its output is in $log." >&2
        exit 1
    fi
}

# By its own name, or as part of another: some builds of nodejs bring npm, and none besides.
is_installed() {
    dpkg-query --show --showformat='${db:Status-Abbrev} ${Package}, ${Provides},\n' |
        grep -E "^ii .*\b$1( \([^)]*\))?," >/dev/null
}

# The packages of a list that are missing, a line each: `one | other` where either will do.
missing_packages() {
    grep -vE '^\s*(#|$)' "$1" | while read -r line; do
        local found=
        for package in ${line//|/ }; do
            if is_installed "$package"; then found=$package; fi
        done
        [ -n "$found" ] || echo "$line"
    done
}

# The first package of a line that this system's archive has.
available() {
    local package
    for package in ${1//|/ }; do
        if [ -n "$(apt-cache show "$package" 2>/dev/null)" ]; then break; fi
    done
    echo "$package"
}

install_debian_packages() {
    local lines=() packages=()
    mapfile -t lines < <(missing_packages "$1")
    [ ${#lines[@]} -eq 0 ] && return
    stage "Debian packages: reading the archive's lists" '^(Get:.*)' as_root apt-get update
    for line in "${lines[@]}"; do packages+=("$(available "$line")"); done
    stage "Debian packages: installing ${packages[*]}, and what they need" \
        '^[dp][lm]status:[^:]*:([0-9]+)[^:]*:(.*)' \
        as_root env DEBIAN_FRONTEND=noninteractive apt-get install --yes \
        --no-install-recommends -o APT::Status-Fd=1 "${packages[@]}"
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
    echo "TAMS needs Python 3.11 or later with venv and headers. Debian 12, Debian 13 and Ubuntu 24.04" \
        "have it; elsewhere install python3.11, python3.11-venv and python3.11-dev (or a later version)." >&2
    exit 1
}

install_pinned() {
    PATH="$PWD/$environment/bin:$PATH" PYTHONUNBUFFERED=1 \
        stage "$1" '^ *(Collecting [^ ]*|Processing [^ ]*|Installing .*|Building .*)' \
        "$environment/bin/python" -m pip install \
        --disable-pip-version-check --progress-bar off --no-compile --require-hashes "${@:2}"
}

pinned() {  # the packages of a lock whose names match, with their hashes
    awk -v name="^($1)==" '/^[^ #]/ { wanted = $0 ~ name } wanted' "$2"
}

all_others() {  # those whose names do not match
    awk -v name="^($1)==" '/^[^ #]/ { wanted = $0 !~ name } wanted' "$2"
}

# On all processors: pip would take one, and a first start would have to do it within its time limits.
compile_all() {
    stage "Python packages: compiling" '' "$environment/bin/python" -m compileall -qq -j 0 "$environment/lib"
}

list=apt-packages${extras:+-tests}.txt
if command -v apt-get >/dev/null; then
    install_debian_packages "$list"
else
    echo "Not Debian or Ubuntu: install what $list lists by hand, then run this again." >&2
fi
if [ -n "$extras" ]; then
    install_pinned "Python packages: extras and what tests need, 1.0 GB in $environment" \
        --only-binary :all: --no-deps --requirement requirements-extras.lock
    compile_all
    touch "$environment/.ready-extras"
    exit
fi
[ -n "$python" ] || python=$(find_python)
[ -x "$environment/bin/python" ] || "$python" -m venv "$environment"

# PyGObject up to 3.50 is built with girepository-1.0, which new systems will not have; later ones
# with girepository-2.0, which Debian 12 does not have.
bindings=requirements.lock
if pkg-config --exists girepository-2.0; then bindings=requirements-girepository-2.lock; fi

# Of PyGObject and pycairo there are no wheels: they are built here, with what is pinned as well.
# Left to itself pip would fetch whatever versions of that are the newest. Nothing else is built.
install_pinned "Python packages: what PyGObject and pycairo are built with" \
    --only-binary :all: --requirement requirements-build.lock
for package in pycairo pygobject; do  # in this order: PyGObject is built with pycairo
    install_pinned "Python packages: building $package" \
        --no-build-isolation --no-deps --requirement <(pinned "$package" "$bindings")
done
install_pinned "Python packages: all others, 0.7 GB in $environment" \
    --only-binary :all: --no-deps --requirement <(all_others 'pycairo|pygobject' requirements.lock)
compile_all
touch "$environment/.ready"
