#!/usr/bin/env bash
# Resolves the requirements for Python 3.11 and newer on every platform, with hashes.
# Existing pins are kept where they still fit; remove the lock first to take the newest of everything.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

uv=$(mktemp -d)
trap 'rm -rf "$uv"' EXIT
.venv/bin/python -m venv "$uv"
"$uv/bin/python" -m pip --disable-pip-version-check install --quiet uv
compile=("$uv/bin/uv" pip compile --quiet --universal --generate-hashes --python-version 3.11 --no-emit-index-url
         --custom-compile-command 'make lock')
"${compile[@]}" pyproject.toml --extra dev --output-file requirements.lock
"${compile[@]}" pyproject.toml --extra ros --constraint requirements.lock --output-file requirements-ros.lock
"${compile[@]}" pyproject.toml --extra bench --constraint requirements.lock --output-file requirements-bench.lock
