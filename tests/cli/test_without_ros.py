# SPDX-License-Identifier: Apache-2.0
"""Bags are read, identified and drawn without an installation of ROS."""

import os
import subprocess
import sys

from ..commands import SAMPLE

# Neither import nor the ament index provides these packages.
WITHOUT_ROS = """
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {"rclpy", "rosidl_parser", "ament_index_python"} or (
            name.endswith(("_msgs", "_interfaces"))
        ):
            raise ModuleNotFoundError(f"{name}: there is no ROS", name=name)

sys.meta_path.insert(0, Missing())
from ema_cli.main import main
for line in sys.argv[1:]:
    print(line, file=sys.stderr, flush=True)
    main(line.split(), standalone_mode=False)
"""
COMMANDS = (
    f"info {SAMPLE}",
    f"estimate {SAMPLE}",
    f"calibrate {SAMPLE} -o c.yaml --accept-defects --accepted-by Ada",
    f"plot {SAMPLE} -o telemetry.png",
    f"compare {SAMPLE} --algorithms least_squares",
)


def test_commands_that_read_a_bag_need_no_ros(tmp_path):
    """All commands run in one process, in which importing ROS raises an error."""
    environment = {name: value for name, value in os.environ.items() if "AMENT" not in name}
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_ROS, *COMMANDS],
        env=environment,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, "ROS" in done.stderr) == (0, False), done.stderr
    assert {path.name for path in tmp_path.iterdir()} >= {"c.yaml", "telemetry.png"}
