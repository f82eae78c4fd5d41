#!/usr/bin/env bash
# Builds .venv from requirements.lock, whatever the starting state: nothing, a half-built or a moved environment,
# or one of another Python. A stamp of everything that went in makes a repeated call cheap.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

locks=(requirements.lock)
# Once asked for, an extra stays until `make clean`: `make test` must not take it away again.
for extra in ros bench docs; do
    if [ "${1:-}" = "$extra" ] || [ -e ".venv/with-$extra" ]; then locks+=("requirements-$extra.lock"); fi
done

usable() { "$1" -c 'import sys; raise SystemExit(sys.version_info < (3, 11))' >/dev/null 2>&1; }

find_python() {
    # A version manager's shim can stand in the path and still refuse to run, so each one is tried.
    local name
    for name in ${PYTHON:+"$PYTHON"} python3.12 python3.11 python3.13 python3 python; do
        if usable "$name"; then "$name" -c 'import sys; print(sys.executable)'; return; fi
    done
    echo "make setup: no Python 3.11 or newer was found. Install python3.11 or python3.12 with its venv module" \
         "(Debian: apt install python3.12-venv), or name one: make setup PYTHON=/path/to/python3.12" >&2
    return 1
}

if [ -z "${PYTHON:-}" ] && usable .venv/bin/python; then python=.venv/bin/python; else python=$(find_python); fi
base=$("$python" -c 'import sys; print(sys._base_executable, sys.version)')
digest() { "$python" -c 'import hashlib, sys; print(hashlib.sha256(sys.stdin.buffer.read()).hexdigest())'; }
packages=$({ echo "$PWD" "$base" "${locks[@]}"; cat "${locks[@]}" tools/setup.sh; } | digest)
project=$({ echo "$packages"; cat pyproject.toml; } | digest)
if [ "$(cat .venv/stamp 2>/dev/null)" = "$project" ] && .venv/bin/twin --version >/dev/null 2>&1; then
    exit 0
fi

pip=(.venv/bin/python -m pip --disable-pip-version-check --no-input install -qq)
# The locks hold every package with its hash, the build back end included, and wheels alone: nothing else is fetched, and
# nothing of it is run while it is installed.
install_locked() {
    local lock
    for lock in "${locks[@]}"; do "${pip[@]}" --require-hashes --no-deps --only-binary :all: -r "$lock" || return; done
    # ROS wheels leave metadata of foreign names that other installers would take for packages to remove.
    rm -rf .venv/lib/python3.*/site-packages/*-py3.*.egg-info
}
# Whether .venv was complete once, and is this Python's and in this place.
known() {
    [ -e .venv/stamp-packages ] && usable .venv/bin/python && grep -qF "$PWD/.venv" .venv/pyvenv.cfg &&
        [ "$base" = "$(.venv/bin/python -c 'import sys; print(sys._base_executable, sys.version)')" ]
}
# What no lock has any more; pip alone would leave it there.
leftovers() {
    .venv/bin/python - "${locks[@]}" <<'EOF'
import re, sys
from importlib.metadata import distributions
plain = lambda name: re.sub(r"[-_.]+", "-", name).lower()
locked = {plain(found) for lock in sys.argv[1:] for found in re.findall(r"^([\w.-]+)==", open(lock).read(), re.M)}
for name in sorted({plain(one.name) for one in distributions() if one.name} - locked - {"pip", "setuptools", "twin-daemon"}):
    print(name)
EOF
}
bring_up_to_date() {
    local left
    mapfile -t left < <(leftovers)
    rm -f .venv/stamp
    if [ ${#left[@]} -gt 0 ]; then .venv/bin/python -m pip --disable-pip-version-check uninstall -q -y "${left[@]}" || return; fi
    install_locked
}

if [ "$(cat .venv/stamp-packages 2>/dev/null)" != "$packages" ] || ! usable .venv/bin/python; then
    if ! { known && bring_up_to_date; }; then
        python=$("$python" -c 'import sys; print(sys._base_executable)')
        echo "Building .venv with $("$python" --version)"
        rm -rf .venv
        if ! "$python" -m venv .venv; then
            rm -rf .venv
            echo "make setup: '$python -m venv' failed. On Debian and Ubuntu: apt install python3-venv" >&2
            exit 1
        fi
        install_locked
    fi
    for lock in "${locks[@]:1}"; do extra=${lock#requirements-}; touch ".venv/with-${extra%.lock}"; done
    echo "$packages" > .venv/stamp-packages
fi
"${pip[@]}" --no-deps --no-build-isolation --editable .
.venv/bin/twin --version
echo "$project" > .venv/stamp
