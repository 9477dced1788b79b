#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# With each supported Python, sets up the project and runs `make quick` and a demo of 10 s.
#
#   tools/test_pythons.sh         # each installed Python of 3.11, 3.12 and 3.13
#   tools/test_pythons.sh 3.13    # a single version
#
# Each version runs in a clone of the last commit, so that .venv does not change.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
versions=("$@")
(($#)) || versions=(3.11 3.12 3.13)
work=$(mktemp -d -t ema_pythons_XXXXXX)
trap 'rm -rf "$work"' EXIT

# python_of VERSION: print the path of a Python with headers and venv, from PATH or pyenv
probe='
import ensurepip, os, sysconfig, venv
os.stat(os.path.join(sysconfig.get_path("include"), "Python.h"))
'
python_of() {
    local candidate
    # A shim of pyenv is on the path even if its version is not selected.
    for candidate in $(type -aP "python$1") "${PYENV_ROOT:-$HOME/.pyenv}"/versions/"$1".*/bin/"python$1"; do
        if [[ -x $candidate ]] && "$candidate" -c "$probe" 2>/dev/null; then
            echo "$candidate"
            return
        fi
    done
}

# The clones must not see the environment of an activated shell.
if [[ -n ${_ROS_WHEELS_BOOTSTRAP_COMPLETE:-} ]]; then
    unset PYTHONPATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH LD_LIBRARY_PATH VIRTUAL_ENV
    unset "${!ROS_@}" FASTRTPS_DEFAULT_PROFILES_FILE
fi

missing=() failed=() passed=()
for version in "${versions[@]}"; do
    python=$(python_of "$version")
    if [[ -z $python ]]; then
        missing+=("$version")
        continue
    fi
    echo "test-pythons: $version: $python"
    clone=$work/$version
    git clone -q "$root" "$clone"
    if (cd "$clone" && unset MAKEFLAGS MFLAGS ARGS && make setup PYTHON="$python" && make quick &&
        make demo DEMO_S=10) </dev/null; then
        passed+=("$version")
    else
        failed+=("$version")
    fi
    rm -rf "$clone"
done
echo "test-pythons: passed: ${passed[*]:-none}; failed: ${failed[*]:-none};" \
    "not found: ${missing[*]:-none}"
if ((${#failed[@]})) || ! ((${#passed[@]})); then exit 1; fi
