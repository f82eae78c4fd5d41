#!/usr/bin/env bash
# Resolves the requirements for Python 3.11 and newer on every platform, with hashes, of wheels alone: nothing is built
# from source on anybody's machine, so nothing is run while it is installed.
# Existing pins are kept where they still fit; remove the lock first to take the newest of everything.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

uv=$(mktemp -d)
trap 'rm -rf "$uv"' EXIT
.venv/bin/python -m venv "$uv"
# The resolver itself is pinned, by the same means. `make lock UV_VERSION=0.13.9` moves it to another version.
"$uv/bin/python" -m pip --disable-pip-version-check --no-input install --quiet --require-hashes \
    --no-deps -r tools/uv.lock
compile=("$uv/bin/uv" pip compile --quiet --universal --generate-hashes --python-version 3.11 --no-emit-index-url
         --only-binary :all: --emit-build-options --custom-compile-command 'make lock')
if [ -n "${UV_VERSION:-}" ]; then
    echo "uv==$UV_VERSION" | "${compile[@]}" - --output-file tools/uv.lock
    echo "tools/uv.lock has uv $UV_VERSION now; 'make lock' resolves with it"
    exit
fi
"${compile[@]}" pyproject.toml --extra dev --output-file requirements.lock
# The one exception: empy has no wheel. Packages of ROS that make code at build time name it, rclpy never asks for it.
echo "empy; python_version < '3'" > "$uv/left-out"
"${compile[@]}" pyproject.toml --extra ros --constraint requirements.lock --override "$uv/left-out" \
    --output-file requirements-ros.lock
"${compile[@]}" pyproject.toml --extra bench --constraint requirements.lock --output-file requirements-bench.lock
"${compile[@]}" pyproject.toml --extra docs --constraint requirements.lock --output-file requirements-docs.lock
