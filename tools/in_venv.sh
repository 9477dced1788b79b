#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs a command in .venv-NAME, which is created from requirements/NAME.lock.txt if necessary.
#
#   tools/in_venv.sh sbom python tools/sbom.py ema.cdx.json
#
# Separate from .venv, whose packages sbom lists. Requires `make setup`.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
name=$1
shift
venv=$root/.venv-$name
lock=$root/requirements/$name.lock.txt
uv=$root/.venv/bin/uv

if [[ ! -x $uv ]]; then
    echo "$name: $uv does not exist: run \`make setup\` first" >&2
    exit 1
fi
# Remove everything that the caller has sourced or activated from the environment.
for variable in ${!PYTHON@} ${!_ROS_@}; do unset "$variable"; done
unset LD_LIBRARY_PATH VIRTUAL_ENV CONDA_PREFIX
export UV_SYSTEM_CERTS=1

digest=$(cat "$lock" "${BASH_SOURCE[0]}" "$root/.venv/.python" | sha256sum)
if [[ ! -e $venv/.packages || $(<"$venv/.packages") != "$digest" ]]; then
    rm -rf "$venv"
    "$uv" venv --quiet --python "$(<"$root/.venv/.python")" "$venv"
    VIRTUAL_ENV=$venv "$uv" pip sync --quiet --require-hashes "$lock"
    echo "$digest" >"$venv/.packages"
fi
export PATH=$venv/bin:$PATH VIRTUAL_ENV=$venv
exec "$@"
