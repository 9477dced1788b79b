#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Compiles requirements/*.in to lock.txt, sbom.lock.txt and docs.lock.txt in the same folder, with the
# hashes of all files of each release. Arguments such as --upgrade are passed to uv.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# Only wheels, so that nothing is compiled, except empy, which has no wheel.
export UV_SYSTEM_CERTS=1 UV_CUSTOM_COMPILE_COMMAND='make lock'
options=("$@")
compile() {
    .venv/bin/uv pip compile --quiet --generate-hashes --python-platform x86_64-manylinux_2_28 \
        --only-binary :all: --no-binary empy --python-version "$@"
}

# lock FILE INPUT...: resolve the versions for the oldest Python, because newer Pythons can use them as
# well. Then resolve again with these versions for each newer Python; this fails if a wheel is missing.
lock() {
    local file=$1 version
    shift
    compile 3.11 "$@" --output-file "$file" "${options[@]}"
    for version in 3.12 3.13; do
        compile "$version" "$@" --constraints "$file" >/dev/null
    done
}

lock requirements/lock.txt requirements/{ros,runtime,dev}.in --excludes requirements/excluded.txt

# A newer ROS distribution would resolve without an error, but would be wrong.
grep -q '^ros-rclpy==7\.1\.[0-9]* ' requirements/lock.txt || {
    echo "lock: rclpy is not version 7.1 of Jazzy: pin the package that requires a newer one in requirements/ros.in" >&2
    exit 1
}

lock requirements/sbom.lock.txt requirements/sbom.in

lock requirements/docs.lock.txt requirements/docs.in
