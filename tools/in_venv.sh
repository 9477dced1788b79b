#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs a command in .venv-NAME, made from requirements/NAME.lock.txt unless it is there already.
#
#   tools/in_venv.sh sbom python tools/sbom.py ema.cdx.json
#
# Apart from .venv, which sbom looks at. Needs what `make setup` makes.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
name=$1
shift
venv=$root/.venv-$name
lock=$root/requirements/$name.lock.txt
uv=$root/.venv/bin/uv

if [[ ! -x $uv ]]; then
    echo "$name: no $uv: run \`make setup\` first" >&2
    exit 1
fi
# From here on nothing that the caller has sourced or activated has any influence.
for variable in ${!PYTHON@} ${!_ROS_@}; do unset "$variable"; done
unset LD_LIBRARY_PATH VIRTUAL_ENV CONDA_PREFIX
export UV_SYSTEM_CERTS=1

wanted=$(cat "$lock" "${BASH_SOURCE[0]}" "$root/.venv/.python" | sha256sum)
if [[ ! -e $venv/.packages || $(<"$venv/.packages") != "$wanted" ]]; then
    rm -rf "$venv"
    "$uv" venv --quiet --python "$(<"$root/.venv/.python")" "$venv"
    VIRTUAL_ENV=$venv "$uv" pip sync --quiet --require-hashes "$lock"
    echo "$wanted" >"$venv/.packages"
fi
export PATH=$venv/bin:$PATH VIRTUAL_ENV=$venv
exec "$@"
