#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Makes .venv, builds ros2_ws and writes activate.sh. What is done already is not done again.
#
#   PYTHON=python3.12 tools/setup.sh
#
# ROS 2 Jazzy comes from the wheels of requirements/lock.txt, so the machine needs Python 3.11 to
# 3.13 and a C++ compiler only. Where a native Jazzy is sourced, that one is used instead.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
venv=$root/.venv
ws=$root/ros2_ws
lock=$root/requirements/lock.txt
log=$ws/log/setup.log
# The packages: of the library at the top, those for ROS alone in the workspace.
bases=("$root"/ema_* "$ws"/src/ema_*)

die() {
    echo "setup: $*" >&2
    exit 1
}

# watch_log LINES: say which package is being built, and for how long, while a step writes the log
watch_log() {
    local from=$1 start=$SECONDS line shown=
    while sleep 1; do
        line=$(tail -n "+$from" "$log" | grep -aoE '^(Starting >>>|Finished <<<) [a-z_]+' | tail -n 1 || true)
        if [[ -t 1 ]]; then
            printf '\r\033[K  %s s  %s' "$((SECONDS - start))" "$line"
        elif [[ $line != "$shown" ]]; then
            shown=$line
            printf '  %s s  %s\n' "$((SECONDS - start))" "$line"
        fi
    done
}

# step NAME SECONDS COMMAND...: run with output to the log; print the usual and the actual duration
step() {
    local name=$1 usual=$2 start=$SECONDS
    shift 2
    echo "setup: $name (usually $usual s) ..."
    watch_log "$(($(wc -l <"$log") + 1))" &
    watcher=$!
    # A subshell of its own, outside any condition: else bash would not heed set -e within.
    set +e
    (set -e; "$@") >>"$log" 2>&1
    local status=$?
    stop_watching
    set -e
    if ((status)); then
        echo "setup: $name failed"
        # Where CI runs, the file is out of reach.
        if [[ -n ${CI:-} ]]; then tail -n 60 "$log"; fi
        die "$name failed${hint:+: $hint}; the whole output is in $log"
    fi
    echo "setup: $name took $((SECONDS - start)) s"
}

watcher=
stop_watching() {
    if [[ -n $watcher ]]; then
        kill "$watcher" 2>/dev/null
        wait "$watcher" 2>/dev/null
        if [[ -t 1 ]]; then printf '\r\033[K'; fi
    fi
    watcher=
}
trap stop_watching EXIT

digest() { sha256sum | cut -c1-32; }

# ---- Where ROS comes from. activate.sh sets _ROS_WHEELS_BOOTSTRAP_COMPLETE: with it set, the Jazzy
# ---- that this shell knows is our own.
native=
if [[ ${ROS_DISTRO:-} == jazzy && -z ${_ROS_WHEELS_BOOTSTRAP_COMPLETE:-} ]]; then
    IFS=: read -ra prefixes <<<"${AMENT_PREFIX_PATH:-}"
    for prefix in "${prefixes[@]}"; do
        if [[ -e $prefix/share/rclpy && -e $prefix/setup.bash ]]; then native=$prefix; fi
    done
fi

# Once chosen, it stays in a shell that has not sourced it.
if [[ -z $native && -e $venv/.native ]]; then native=$(<"$venv/.native"); fi
if [[ -z $native && $(uname -sm) != 'Linux x86_64' ]]; then
    die "no ROS 2 wheels for $(uname -sm): install ROS 2 Jazzy natively and source it"
fi

# ---- From here on nothing that the caller has sourced or activated has any influence.
for name in ${!ROS_@} ${!AMENT_@} ${!COLCON_@} ${!CMAKE_@} ${!PYTHON@}; do
    if [[ $name != PYTHON ]]; then unset "$name"; fi
done
unset LD_LIBRARY_PATH PKG_CONFIG_PATH VIRTUAL_ENV CONDA_PREFIX MAKEFLAGS MFLAGS name
export UV_SYSTEM_CERTS=1 PIP_DISABLE_PIP_VERSION_CHECK=1

# source_underlay: ROS itself, without our workspace. Its scripts read unset variables.
source_underlay() {
    set +u
    if [[ -n $native ]]; then
        source "$native/setup.bash"
    else
        local libs
        libs=$(printf ':%s' "$venv"/lib/python3.*/site-packages/ros_*.libs)
        export AMENT_PREFIX_PATH=$venv CMAKE_PREFIX_PATH=$venv LD_LIBRARY_PATH=$venv/lib$libs
        # Otherwise Python runs itself anew to set LD_LIBRARY_PATH, in an order of its own.
        export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1 RMW_IMPLEMENTATION=rmw_fastrtps_cpp ROS_DISTRO=jazzy
    fi
    export PATH=$venv/bin:$PATH
    set -u
}

# ---- Python
# Prints the interpreter behind a command (which may be a shim or in a virtual environment), or says
# on stderr what it lacks.
probe='
import os, sys, sysconfig
version = "%d.%d" % sys.version_info[:2]
if not (3, 11) <= sys.version_info[:2] <= (3, 13):
    sys.exit("is Python %s: set PYTHON to a Python 3.11, 3.12 or 3.13" % version)
try:
    import ensurepip, venv
except ImportError:
    sys.exit("has no venv: install it with `sudo apt install python%s-venv`" % version)
if not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")):
    sys.exit("has no headers: install them with `sudo apt install python%s-dev`" % version)
print(os.path.realpath(sys._base_executable))
'
find_python() {
    local candidates=(python3.12 python3.11 python3.13 python3) candidate found complaint=
    if [[ -n $native ]]; then candidates=(/usr/bin/python3); fi # rclpy is compiled for this one
    if [[ -n ${PYTHON:-} ]]; then candidates=("$PYTHON"); fi
    # Without an order to the contrary, stay with the Python that was chosen the first time.
    if [[ -z ${PYTHON:-} && -e $venv/.python ]]; then candidates=("$(<"$venv/.python")" "${candidates[@]}"); fi
    for candidate in "${candidates[@]}"; do
        if ! command -v "$candidate" >/dev/null; then continue; fi
        if found=$("$candidate" -c "$probe" 2>&1) && [[ -x $found ]]; then
            echo "$found"
            return
        fi
        # A shim without an interpreter behind it also fails, in many lines of its own.
        if [[ $found == *$'\n'* ]]; then continue; fi
        complaint=${complaint:-$candidate $found}
    done
    die "${complaint:-no Python 3.11 to 3.13${PYTHON:+ called $PYTHON}: install one with \`sudo apt install python3 python3-venv python3-dev\` or set PYTHON}"
}

# ---- Steps
make_venv() {
    rm -rf "$venv" "$ws/build" "$ws/install"
    "$python" -m venv ${native:+--system-site-packages} "$venv"
    echo "$python" >"$venv/.python"
    echo "$native" >"$venv/.native"
}

# entries [!] PATTERN: the entries of the lock, with their hashes, that match a pattern (!: do not)
entries() {
    local wanted=1
    if [[ $1 == '!' ]]; then wanted=0 && shift; fi
    awk -v pattern="$1" -v wanted=$wanted '/^[^ ]/ { here = ($0 ~ pattern) == wanted } here' "$lock"
}

# On a native ROS, apt's build tools and apt's numpy stay: the message packages are compiled for it.
locked() {
    if [[ -n $native ]]; then
        entries ! '^(ros-|colcon-|(catkin-pkg|empy|lark-parser|cmake|ninja|setuptools|numpy)==)'
    else
        cat "$lock"
    fi
}

install_packages() {
    local pip=("$venv/bin/python" -m pip install --no-deps --require-hashes) list=$venv/lock.txt
    locked >"$list"
    entries '^uv==' >"$venv/uv.txt"
    if "${pip[@]}" -r "$venv/uv.txt"; then
        # Not `uv pip sync`: the wheels hold egg-info folders, which it takes for packages that do not
        # belong here and removes. The lock also holds what builds empy, which has no wheel.
        if VIRTUAL_ENV=$venv "$venv/bin/uv" pip install --no-deps --require-hashes \
            --build-constraint "$lock" -r "$list"; then return; fi
    fi
    echo 'setup: uv failed, trying pip'
    "${pip[@]}" -r "$list"
}

build() {
    source_underlay
    # The scripts of the packages begin with the Python that runs colcon: let it be ours.
    local colcon cmake_args=("-DPython3_EXECUTABLE=$venv/bin/python")
    colcon=$(command -v colcon)
    if [[ -z $native ]]; then
        cmake_args+=(-GNinja "-DCMAKE_PROJECT_INCLUDE=$root/tools/wheel_includes.cmake")
        cmake_args+=(-DEMA_FOR_RCLPY_ALONE=ON)
    fi
    # Else colcon stops starting compilers at a load of the number of cores, which is the load of
    # its own two: one at a time.
    local MAKEFLAGS
    MAKEFLAGS=-j$(nproc)
    export MAKEFLAGS
    cd "$ws"
    "$venv/bin/python" "$colcon" --log-base log build --symlink-install --paths "${bases[@]}" \
        --event-handlers console_direct+ --cmake-args "${cmake_args[@]}"
}

# Works out the environment once, from nothing, and writes it as plain exports.
write_activate() {
    local base=/usr/bin:/bin name value
    PATH=$base
    source_underlay
    set +u
    source "$ws/install/local_setup.bash"
    set -u
    PATH=$ws/install/ema_cli/lib/ema_cli:$PATH
    {
        echo '# Written by tools/setup.sh: the environment of this workspace, for bash, zsh and dash.'
        echo
        echo '# _prepend NAME PATHS: put PATHS in front of $NAME, if they are not there yet'
        echo '_prepend() {'
        echo '    eval "_before=\${$1-}"'
        echo '    case ":$_before:" in'
        echo '        *":$2:"*) ;;'
        echo '        *) export "$1=$2${_before:+:$_before}" ;;'
        echo '    esac'
        echo '}'
        for name in PATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH LD_LIBRARY_PATH PYTHONPATH; do
            value=${!name-}
            value=${value%":$base"}
            echo "_prepend $name '${value%:}'"
        done
        echo 'unset -f _prepend'
        echo 'unset _before'
        echo
        echo "export VIRTUAL_ENV='$venv'"
        echo 'export ROS_DISTRO=jazzy ROS_VERSION=2 ROS_PYTHON_VERSION=3'
        if [[ -z $native ]]; then
            echo "export RMW_IMPLEMENTATION=$RMW_IMPLEMENTATION _ROS_WHEELS_BOOTSTRAP_COMPLETE=1"
        fi
        echo "export FASTRTPS_DEFAULT_PROFILES_FILE=\"\${FASTRTPS_DEFAULT_PROFILES_FILE:-$root/tools/fastdds.xml}\""
    } >"$root/activate.sh.new"
    mv "$root/activate.sh.new" "$root/activate.sh"
}

# Into the user's cache: both forms of the model, and what a first simulation, identification and
# prognosis use.
compile_kernels() {
    source "$root/activate.sh"
    local folder
    folder=$(mktemp -d)
    python -c 'from ema_monitor.model.monitor_model import compile_kernels; compile_kernels()'
    ema simulate --cycles 2 -o "$folder/two.mcap"
    ema predict "$folder/two.mcap" --hours-per-cycle 10
    rm -r "$folder"
}

# Of what this Python imports from here. Where PYTHONDONTWRITEBYTECODE is set, every process of a
# node or command would compile it anew. What is up to date is left as it is, in a twentieth of a
# second.
compile_bytecode() { "$venv/bin/python" -m compileall -q "${bases[@]}"; }

# ---- What has to be done
if [[ $root == *[[:space:]\'\"]* ]]; then
    die "the path '$root' has a space or quote in it: move the repository"
fi
mkdir -p "$ws/log"
# One at a time. The lock is on this script, which is always there.
exec 9<"${BASH_SOURCE[0]}"
if ! flock --nonblock 9; then
    echo 'setup: waiting for another one to finish'
    flock 9
fi

python=$(find_python)
packages=$({
    echo "$root $python $("$python" -V) $native"
    cat "$lock" "${BASH_SOURCE[0]}"
} | digest)
# Edits of Python modules act at once, through links. New interfaces, entry points and installed
# files do not.
sources=$({
    echo "$packages"
    cat "$root/tools/wheel_includes.cmake"
    find "${bases[@]}" -type f \( -name package.xml -o -name CMakeLists.txt -o -name 'setup.*' \
        -o -name '*.msg' -o -name '*.srv' -o -name '*.action' \) -not -name '*.pyc' -print0 |
        sort -z | xargs -0 sha256sum
    find "${bases[@]}" -type f \( -path '*/launch/*' -o -path '*/config/*' -o -path '*/policies/*' \
        -o -path '*/layouts/*' \) \
        -not -name '*.pyc' | sort
} | digest)

# done_for STAMP DIGEST: whether a step was finished for these inputs
done_for() { [[ -e $1 && $(<"$1") == "$2" ]]; }

have_packages=
if done_for "$venv/.packages" "$packages" && "$venv/bin/python" -c '' 2>/dev/null; then
    have_packages=1
    if done_for "$ws/install/.sources" "$sources" && [[ -e $root/activate.sh ]]; then
        # An edited source may be in the midst of a change, and a tree may be read-only.
        compile_bytecode >/dev/null 2>&1 || true
        exit 0
    fi
fi

compiler=
for candidate in "${CXX:-}" c++ g++ clang++; do
    if command -v "$candidate" >/dev/null; then compiler=$candidate; fi
done
if [[ -z $compiler ]]; then die 'no C++ compiler: install one with `sudo apt install g++`'; fi

: >"$log"
if [[ -z $have_packages ]]; then
    step "creating .venv with $("$python" -V)" 5 make_venv
    hint='is the network there, and can pip reach its package index? Then run the same again' \
        step 'downloading 230 MB of packages (requirements/lock.txt)' '10 to 60' install_packages
    echo "$packages" >"$venv/.packages"
fi
rm -f "$ws/install/.sources"
step 'building the messages and packages of ros2_ws' '40 to 60' build
step 'compiling the modules' 1 compile_bytecode
step 'writing activate.sh' 1 write_activate
step 'compiling the kernels' '10 to 40' compile_kernels
echo "$sources" >"$ws/install/.sources"
