#!/usr/bin/env bash
# Compiles requirements/*.in to requirements/lock.txt. Arguments go to uv, e.g. --upgrade.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# Wheels only, so that nothing is compiled; empy comes as a (plain Python) source.
export UV_SYSTEM_CERTS=1 UV_CUSTOM_COMPILE_COMMAND='make lock'
compile() {
    .venv/bin/uv pip compile --quiet --python-platform x86_64-manylinux_2_28 \
        --only-binary :all: --no-binary empy --python-version "$@"
}

# What the oldest Python can use, the newer ones can: resolve for it, then let each of the others
# resolve again within these versions, which fails where a wheel is missing.
compile 3.11 requirements/{ros,runtime,dev}.in --output-file requirements/lock.txt "$@"
for version in 3.12 3.13; do
    compile "$version" requirements/{ros,runtime,dev}.in --constraints requirements/lock.txt >/dev/null
done

# A newer ROS distribution is the one thing that resolves well and is wrong all the same.
grep -qx 'ros-rclpy==7\.1\.[0-9]*' requirements/lock.txt || {
    echo "lock: rclpy is not Jazzy's 7.1: pin what brought it in requirements/ros.in" >&2
    exit 1
}
