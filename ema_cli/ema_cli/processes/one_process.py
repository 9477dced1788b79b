"""Several nodes in one process, for a small machine: ``NODE... --ros-args ...``."""

import sys

from ema_cli.processes.bringup import node_class
from ema_ros.run import run_together


def main() -> int:
    """Run the nodes that the command line names."""
    end = sys.argv.index("--ros-args")
    classes = [node_class(name) for name in sys.argv[1:end]]
    return run_together(classes, [sys.argv[0], *sys.argv[end:]])


if __name__ == "__main__":
    raise SystemExit(main())
