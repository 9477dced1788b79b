"""Bags are read, identified and drawn where there is no ROS at all."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

SAMPLE = Path(__file__).parents[2] / "bags" / "faulty_flap.mcap"
# Found neither by import nor by the ament index.
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
main()
"""


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if "AMENT" not in name}
    return subprocess.run(
        [sys.executable, "-c", WITHOUT_ROS, *map(str, arguments)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(
    "arguments",
    [
        ("info", SAMPLE),
        ("estimate", SAMPLE),
        ("calibrate", SAMPLE, "-o", "c.yaml"),
        ("plot", SAMPLE, "-o", "telemetry.png"),
        ("compare", SAMPLE, "--algorithms", "least_squares", "-o", "compare.png"),
    ],
    ids=lambda arguments: arguments[0],
)
def test_command_that_reads_a_bag_needs_no_ros(tmp_path, monkeypatch, arguments):
    monkeypatch.chdir(tmp_path)
    done = run(*arguments)
    assert (done.returncode, "ROS" in done.stderr) == (0, False), done.stderr
