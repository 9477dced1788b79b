#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Creates .venv, builds ros2_ws and writes activate.sh. Completed steps are skipped.
#
#   PYTHON=python3.12 tools/setup.sh
#
# ROS 2 Jazzy is installed from the wheels in requirements/lock.txt, so the machine only needs Python
# 3.11 to 3.13 and a C++ compiler. If a native Jazzy is sourced, it is used instead.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
venv=$root/.venv
ws=$root/ros2_ws
lock=$root/requirements/lock.txt
log=$ws/log/setup.log
# The packages: the library is at the top, and packages that need ROS are in the workspace.
bases=("$root"/ema_* "$ws"/src/ema_*)

die() {
    echo "setup: $*" >&2
    exit 1
}

# watch_log LINE: while a step writes the log, report from this line of the log on which package is
# being built, and the time since the start of the step
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
    # Run in a subshell outside any condition, because bash ignores set -e inside a condition.
    set +e
    (set -e; "$@") >>"$log" 2>&1
    local status=$?
    stop_watching
    set -e
    if ((status)); then
        echo "setup: $name failed"
        # The log file is not available after a run of CI.
        if [[ -n ${CI:-} ]]; then tail -n 60 "$log"; fi
        die "$name failed${hint:+: $hint}; the complete output is in $log"
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

# ---- Find a native ROS. If _ROS_WHEELS_BOOTSTRAP_COMPLETE is set, activate.sh was sourced, and
# ---- ROS_DISTRO refers to the Jazzy in .venv.
native=
if [[ ${ROS_DISTRO:-} == jazzy && -z ${_ROS_WHEELS_BOOTSTRAP_COMPLETE:-} ]]; then
    IFS=: read -ra prefixes <<<"${AMENT_PREFIX_PATH:-}"
    for prefix in "${prefixes[@]}"; do
        if [[ -e $prefix/share/rclpy && -e $prefix/setup.bash ]]; then native=$prefix; fi
    done
fi

# A native ROS remains in use even if a later shell has not sourced it.
if [[ -z $native && -e $venv/.native ]]; then native=$(<"$venv/.native"); fi
if [[ -z $native && $(uname -sm) != 'Linux x86_64' ]]; then
    die "no ROS 2 wheels for $(uname -sm): install ROS 2 Jazzy natively and source it"
fi

# ---- Remove everything that the caller has sourced or activated from the environment.
for name in ${!ROS_@} ${!AMENT_@} ${!COLCON_@} ${!CMAKE_@} ${!PYTHON@}; do
    if [[ $name != PYTHON ]]; then unset "$name"; fi
done
unset LD_LIBRARY_PATH PKG_CONFIG_PATH VIRTUAL_ENV CONDA_PREFIX MAKEFLAGS MFLAGS name
export UV_SYSTEM_CERTS=1 PIP_DISABLE_PIP_VERSION_CHECK=1

# source_underlay: set the environment of ROS without the workspace. Its scripts read unset variables.
source_underlay() {
    set +u
    if [[ -n $native ]]; then
        source "$native/setup.bash"
    else
        local libs
        libs=$(printf ':%s' "$venv"/lib/python3.*/site-packages/ros_*.libs)
        export AMENT_PREFIX_PATH=$venv CMAKE_PREFIX_PATH=$venv LD_LIBRARY_PATH=$venv/lib$libs
        # Otherwise Python restarts itself with another order of LD_LIBRARY_PATH.
        export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1 RMW_IMPLEMENTATION=rmw_fastrtps_cpp ROS_DISTRO=jazzy
    fi
    export PATH=$venv/bin:$PATH
    set -u
}

# ---- Python
# Prints the interpreter that a command runs (the command may be a shim or in a virtual environment),
# or prints to stderr what the interpreter lacks.
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
    local candidates=(python3.12 python3.11 python3.13 python3) candidate output complaint=
    if [[ -n $native ]]; then candidates=(/usr/bin/python3); fi # rclpy is compiled for this one
    if [[ -n ${PYTHON:-} ]]; then candidates=("$PYTHON"); fi
    # If PYTHON is not set, prefer the Python of an earlier run.
    if [[ -z ${PYTHON:-} && -e $venv/.python ]]; then candidates=("$(<"$venv/.python")" "${candidates[@]}"); fi
    for candidate in "${candidates[@]}"; do
        if ! command -v "$candidate" >/dev/null; then continue; fi
        if output=$("$candidate" -c "$probe" 2>&1) && [[ -x $output ]]; then
            echo "$output"
            return
        fi
        # A shim without an interpreter prints several lines of its own: ignore them.
        if [[ $output == *$'\n'* ]]; then continue; fi
        complaint=${complaint:-$candidate $output}
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

# entries [!] PATTERN: print the entries of the lock file, with their hashes, that match a pattern
# (!: that do not match)
entries() {
    local matches=1
    if [[ $1 == '!' ]]; then matches=0 && shift; fi
    awk -v pattern="$1" -v matches=$matches '/^[^ ]/ { is_wanted = ($0 ~ pattern) == matches } is_wanted' "$lock"
}

# locked: print the entries to install. With a native ROS, the build tools and numpy of apt are used,
# because the message packages are compiled for this numpy.
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
        # Not `uv pip sync`: the wheels contain egg-info folders, which it removes as unknown packages.
        # The lock file also contains the build requirements of empy, which has no wheel.
        if VIRTUAL_ENV=$venv "$venv/bin/uv" pip install --no-deps --require-hashes \
            --build-constraint "$lock" -r "$list"; then return; fi
    fi
    echo 'setup: uv failed, trying pip'
    "${pip[@]}" -r "$list"
}

build() {
    source_underlay
    # Run colcon with the Python of .venv, because it becomes the interpreter of the packages' scripts.
    local colcon cmake_args=("-DPython3_EXECUTABLE=$venv/bin/python")
    colcon=$(command -v colcon)
    if [[ -z $native ]]; then
        cmake_args+=(-GNinja "-DCMAKE_PROJECT_INCLUDE=$root/tools/wheel_includes.cmake")
        cmake_args+=(-DEMA_FOR_RCLPY_ALONE=ON)
    fi
    # By default, colcon starts no further compiler at a load average of the number of cores. With two
    # cores, it would compile one file at a time.
    local MAKEFLAGS
    MAKEFLAGS=-j$(nproc)
    export MAKEFLAGS
    cd "$ws"
    "$venv/bin/python" "$colcon" --log-base log build --symlink-install --paths "${bases[@]}" \
        --event-handlers console_direct+ --cmake-args "${cmake_args[@]}"
}

# Determine the environment once, from an empty one, and write it as plain exports.
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
        echo '# _prepend NAME PATHS: put PATHS in front of $NAME, unless it contains them'
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

# Compile both forms of the model, and the functions that a first simulation, identification and
# prognosis use, into the cache of the user.
compile_kernels() {
    source "$root/activate.sh"
    local folder
    folder=$(mktemp -d)
    python -c 'from ema_monitor.model.monitor_model import compile_kernels; compile_kernels()'
    ema simulate --cycles 2 -o "$folder/two.mcap"
    ema predict "$folder/two.mcap" --hours-per-cycle 10
    rm -r "$folder"
}

# Compile the modules of the packages. Otherwise, if PYTHONDONTWRITEBYTECODE is set, each process of a
# node or command compiles them again. If all modules are up to date, this takes 0.05 s.
compile_bytecode() { "$venv/bin/python" -m compileall -q "${bases[@]}"; }

# ---- Find the steps to run
if [[ $root == *[[:space:]\'\"]* ]]; then
    die "the path '$root' contains a space or quote: move the repository"
fi
mkdir -p "$ws/log"
# Only one setup may run at a time. The lock is on this script, which always exists.
exec 9<"${BASH_SOURCE[0]}"
if ! flock --nonblock 9; then
    echo 'setup: waiting for another setup to finish'
    flock 9
fi

python=$(find_python)
packages=$({
    echo "$root $python $("$python" -V) $native"
    cat "$lock" "${BASH_SOURCE[0]}"
} | digest)
# Edits of Python modules need no build, because the modules are linked. New interfaces, entry points
# and installed files need one.
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

# done_for STAMP DIGEST: succeed if the step with this stamp file was completed for these inputs
done_for() { [[ -e $1 && $(<"$1") == "$2" ]]; }

have_packages=
if done_for "$venv/.packages" "$packages" && "$venv/bin/python" -c '' 2>/dev/null; then
    have_packages=1
    if done_for "$ws/install/.sources" "$sources" && [[ -e $root/activate.sh ]]; then
        # Ignore errors: a module may be incomplete while it is edited, and the folder may be read-only.
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
    hint='check the network and that pip can reach its package index, then run the command again' \
        step 'downloading 230 MB of packages (requirements/lock.txt)' '10 to 60' install_packages
    echo "$packages" >"$venv/.packages"
fi
rm -f "$ws/install/.sources"
step 'building the messages and packages of ros2_ws' '40 to 60' build
step 'compiling the modules' 1 compile_bytecode
step 'writing activate.sh' 1 write_activate
step 'compiling the kernels' '10 to 40' compile_kernels
echo "$sources" >"$ws/install/.sources"
