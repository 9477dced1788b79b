"""What a recorder that is killed has lost: blocks published before its end that are not in the bag.

Blocks of 10 ms are published at 100 Hz; after a random time the recorder gets SIGKILL.
docs/nodes.md promises that no more than ``flush_s`` is lost of what the recorder has received.
"""

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from ema_cli.processes.domains import Domain

BLOCK_S = 0.01


class Source(threading.Thread):
    """Publishes numbered blocks, and notes when."""

    def __init__(self, node: Any) -> None:
        super().__init__(daemon=True)
        from ema_core.telemetry import Telemetry
        from ema_interfaces.msg import TelemetryBlock
        from ema_ros import topics
        from ema_ros.messages import telemetry_to_message

        self._publisher = node.create_publisher(TelemetryBlock, "telemetry", topics.STREAM)
        rng = np.random.default_rng(3)
        columns = rng.normal(size=(4, 100))
        self._message = telemetry_to_message(Telemetry(0, 1e-4, 0, *columns), "flap")
        self.sent_s: list[float] = []
        self.is_over = threading.Event()

    @property
    def is_heard(self) -> bool:
        return bool(self._publisher.get_subscription_count())

    def run(self) -> None:
        due_s = time.monotonic()
        while not self.is_over.is_set():
            self._message.first_index = 100 * len(self.sent_s)
            self.sent_s.append(time.monotonic())
            self._publisher.publish(self._message)
            due_s += BLOCK_S
            time.sleep(max(0.0, due_s - time.monotonic()))


def lost_by_a_kill(folder: Path, rng: random.Random, flush_s: float) -> tuple[int, float]:
    """Return how many blocks were lost, and the time from the first of them to the kill [s]."""
    import rclpy
    from rclpy.context import Context
    from rclpy.node import Node

    from ema_bags.reader import Bag

    command = [sys.executable, "-m", "ema_bags.recorder_node", "--ros-args"]
    bag = folder / f"bag_{rng.getrandbits(40)}"
    options = ["-p", f"output:={bag}", "-p", f"flush_s:={flush_s}", "-p", "topics:=['telemetry']"]
    context = Context()
    rclpy.init(context=context)
    node = Node("source", namespace="/ema", context=context)
    source = Source(node)
    with subprocess.Popen([*command, *options], stderr=subprocess.DEVNULL) as recorder:
        while not source.is_heard:
            time.sleep(0.01)
        source.start()
        time.sleep(rng.uniform(2.0, 3.5))
        killed_s = time.monotonic()
        recorder.send_signal(signal.SIGKILL)
    source.is_over.set()
    source.join()
    node.destroy_node()
    context.try_shutdown()
    before = sum(sent_s < killed_s for sent_s in source.sent_s)
    last = max(
        (item.message.first_index // 100 for item in Bag(bag).messages(["/ema/telemetry"])),
        default=-1,
    )
    lost = max(0, before - 1 - last)
    return lost, killed_s - source.sent_s[last + 1] if lost else 0.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10, help="kills in each condition")
    parser.add_argument("--busy", type=int, default=8, help="busy processes in the second one")
    parser.add_argument("--flush", type=float, default=0.5, help="flush_s of the recorder [s]")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rng = random.Random(options.seed)
    print(f"seed {options.seed}, flush_s {options.flush:g} s")
    results = {}
    with closing(Domain()) as domain, tempfile.TemporaryDirectory() as folder:
        os.environ["ROS_DOMAIN_ID"] = str(domain.number)
        for name, busy in (("idle", 0), (f"{options.busy} busy", options.busy)):
            spinning = [
                subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(busy)
            ]
            try:
                found = [
                    lost_by_a_kill(Path(folder), rng, options.flush) for _ in range(options.runs)
                ]
            finally:
                for process in spinning:
                    process.kill()
                    process.wait()
            blocks, seconds = np.array(found).T
            results[name] = {
                "blocks_median": float(np.median(blocks)),
                "blocks_most": int(blocks.max()),
                "seconds_median": float(np.median(seconds)),
                "seconds_most": float(seconds.max()),
            }
            print(
                f"{name:8s} lost: median {np.median(blocks):.0f} blocks, "
                f"{np.median(seconds):.2f} s; most {blocks.max():.0f} blocks, {seconds.max():.2f} s"
            )
    if options.json:
        options.json.write_text(json.dumps(results, indent=2))


if __name__ == "__main__":
    main()
