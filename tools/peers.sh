#!/usr/bin/env bash
# Runs a command in .venv-peers: our packages beside the prognostics that users would pick instead.
#
#   cd benchmarks && ../tools/peers.sh python -m prognosis.own_laws
#
# Makes .venv-peers from requirements/peers.lock.txt unless it is there already. There is no ROS in
# it: the packages are imported from the sources. Needs what `make setup` makes.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
venv=$root/.venv-peers
lock=$root/requirements/peers.lock.txt
uv=$root/.venv/bin/uv

if [[ ! -x $uv ]]; then
    echo "peers: no $uv: run \`make setup\` first" >&2
    exit 1
fi

# From here on nothing that the caller has sourced or activated has any influence.
for name in ${!PYTHON@} ${!_ROS_@}; do unset "$name"; done
unset LD_LIBRARY_PATH VIRTUAL_ENV CONDA_PREFIX
export UV_SYSTEM_CERTS=1

# One at a time. The lock is on this script, which is always there.
exec 9<"${BASH_SOURCE[0]}"
flock 9
python=$(<"$root/.venv/.python")
wanted=$({
    echo "$root $("$python" -V)"
    cat "$lock" "${BASH_SOURCE[0]}"
} | sha256sum)
if [[ ! -e $venv/.packages || $(<"$venv/.packages") != "$wanted" ]]; then
    echo 'peers: .venv-peers from requirements/peers.lock.txt' >&2
    rm -rf "$venv"
    "$uv" venv --quiet --python "$python" "$venv"
    VIRTUAL_ENV=$venv "$uv" pip sync --quiet --require-hashes \
        --build-constraint "$root/requirements/lock.txt" "$lock"
    echo "$wanted" >"$venv/.packages"
fi
exec 9<&-

export PATH=$venv/bin:$PATH VIRTUAL_ENV=$venv
export PYTHONPATH=$root/ema_core:$root/ema_sim:$root/ema_monitor:$root/ema_study
exec "$@"
