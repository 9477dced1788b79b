#!/usr/bin/env bash
# Sets the project up, runs `make quick` and a demo of ten seconds, with each Python that it is for.
#
#   tools/test_pythons.sh         # Python 3.11, 3.12 and 3.13, those installed
#   tools/test_pythons.sh 3.13    # one of them
#
# Each runs in a clone of the last commit, so that .venv stays as it is.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
versions=("$@")
(($#)) || versions=(3.11 3.12 3.13)
work=$(mktemp -d -t ema_pythons_XXXXXX)
trap 'rm -rf "$work"' EXIT

# python_of VERSION: print an interpreter of that version, on the path or of pyenv
python_of() {
    local candidate
    for candidate in "$(command -v "python$1" || true)" \
        "${PYENV_ROOT:-$HOME/.pyenv}"/versions/"$1".*/bin/"python$1"; do
        # A shim of pyenv is on the path whether its version is chosen or not.
        if [[ -x $candidate ]] && "$candidate" -c 'import ensurepip, venv' 2>/dev/null; then
            echo "$candidate"
            return
        fi
    done
}

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
    if (cd "$clone" && unset MAKEFLAGS MFLAGS && make setup PYTHON="$python" && make quick &&
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
