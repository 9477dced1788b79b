#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs the packages that work without ROS with pip, identifies the faults of the sample bag, and
# writes an archive.
#
#   tools/pip_check.sh        # with the Python of .venv and the versions in requirements/lock.txt
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
for name in ${!ROS_@} ${!AMENT_@} ${!PYTHON@}; do unset "$name"; done
unset LD_LIBRARY_PATH VIRTUAL_ENV
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

"$(<"$root/.venv/.python")" -m venv "$folder/venv"
grep -oE '^[^ #]+==[^ ]+' "$root/requirements/lock.txt" | grep -v '^ros-' >"$folder/constraints.txt"
# Copy the packages, because pip would build in the source folders.
for package in ema_core ema_sim ema_monitor ema_archive ros2_ws/src/ema_ros ros2_ws/src/ema_bags; do
    cp -r "$root/$package" "$folder"
done
cd "$folder"
packages=(./ema_core ./ema_ros ./ema_sim ./ema_monitor ./ema_bags ./ema_archive)
# pip does not check hashes if it installs a folder: install the dependencies with hashes first.
venv/bin/pip install --quiet --disable-pip-version-check --constraint constraints.txt \
    --dry-run --report needed.json "${packages[@]}"
"$root/.venv/bin/python" - "$root/requirements/lock.txt" >needed.txt <<'EOF'
import json
import re
import sys
from pathlib import Path

items = json.loads(Path("needed.json").read_text())["install"]
needed = {re.sub(r"[-_.]+", "-", item["metadata"]["name"]).lower() for item in items} | {"setuptools"}
for entry in re.split(r"\n(?=\S)", Path(sys.argv[1]).read_text()):
    if entry.split("==")[0] in needed:
        print(entry)
EOF
venv/bin/pip install --quiet --disable-pip-version-check --require-hashes -r needed.txt
venv/bin/pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation "${packages[@]}"
venv/bin/pip check
rm -rf ema_*
# Copy only the sample bag: the folder may also contain bags of demos.
mkdir bags
cp "$root/bags/faulty_flap.mcap" bags
XDG_CACHE_HOME=$folder venv/bin/python - bags/faulty_flap.mcap <<'EOF'
import sys
from pathlib import Path

from ema_archive.manifest import Manifest
from ema_archive.query import answer
from ema_archive.running import run, scan
from ema_core.tasks import Workers
from ema_monitor import identify
from ema_monitor.recordings import read_windows

windows = read_windows(sys.argv[1])
estimate = identify(windows.usable[0], windows.description)
print(estimate)
with Manifest(Path("archive"), is_new=True) as manifest, Workers("threads", 1) as workers:
    scan(manifest, [str(Path(sys.argv[1]).parent)])
    run(manifest, workers)
_, rows = answer(Path("archive"), "select friction from estimates where valid")
assert rows == [(estimate.faults.friction,)], rows
assert "rclpy" not in sys.modules
assert estimate.valid
assert abs(estimate.faults.friction - 0.25) < 4.0 * estimate.sigma.friction
EOF
echo "pip install without ROS: the packages read a bag, identify faults and write an archive"
