# SPDX-License-Identifier: Apache-2.0
"""Processor time of one monitor that follows 100 unknown drives in ordinary motion.

    python benchmarks/many_joints.py [--joints N] [--blocks 0.1,0.01] [--records N] [--json FILE]

`ema calibrate` calibrates units of the 100 Hz joint ``servo`` of joint_plants. Their consecutive
records of ordinary motion serve as the telemetry of all joints. A monitor node receives the
serialised messages and compares the records with the calibrations. The processor time excludes the
middleware and the executor, because the messages are passed to the callbacks of the node.
"""

import os
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import rclpy
from joint_plants import HEALTHY, Unit, healthy_days
from joints import run
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message
from rich.table import Table
from script import Figures, Workers, command, in_a_process
from targets import Row, at_least, at_most, grid, none_of

from ema_bags.inputs.files import open_input
from ema_bags.inputs.importing import import_series
from ema_bags.inputs.mapping import load_mapping
from ema_core.description import ActuatorDescription
from ema_core.domains import Domain
from ema_core.telemetry import PAUSE_S, Telemetry, join
from ema_interfaces.msg import FaultEstimate, TelemetryBlock
from ema_monitor.calibration.joint_calibration import JointCalibration
from ema_monitor.calibrations import load_calibration
from ema_monitor.node.monitor_node import MonitorNode
from ema_ros.actuator_file import load_description
from ema_ros.messages import description_to_message, telemetry_to_message
from ema_ros.topics import NAMESPACE

MOST_CORES: Final = 0.5
"""Largest processor time of 100 joints [cores]."""

JOINT: Final = "servo"

_UNITS: Final = 4
_RECORDS: Final = 3
_HEALTHY: Final = 6
_PATIENCE_S: Final = 300.0


def recorded_units(folder: Path, joints: int) -> tuple[list[list[Telemetry]], ActuatorDescription]:
    """Calibrate units and store a calibration for each joint.

    Return the records of each unit, and the description of the last one.
    """
    records, description = [], ActuatorDescription()
    for number in range(_UNITS):
        unit, place = Unit(JOINT, number), folder / f"unit_{number}"
        unit.write_description(place)
        days = enumerate(healthy_days(_HEALTHY, 3))
        healthy = [unit.write(unit.record(*day), place, f"healthy_{i}") for i, day in days]
        code, _, errors, _ = run("calibrate", *healthy, "-o", place / "calibration.yaml")
        if code:
            raise RuntimeError(errors)
        calibration = load_calibration(place / "calibration.yaml")
        assert isinstance(calibration, JointCalibration)
        for joint in range(number, joints, _UNITS):
            name = f"joint_{joint}"
            replace(calibration, actuator_id=name).save(folder / f"{name}.yaml")
        mapping = load_mapping(place / "mapping.yaml")
        records.append([])
        for i in range(_RECORDS):
            path = unit.write(unit.record(40 + i, 0, HEALTHY), place, f"test_{i}")
            described = load_description(place / "actuator.yaml")
            imported = import_series(open_input(path, mapping).series(mapping), mapping, described)
            description = imported.description
            records[-1].append(join(list(imported.blocks())))
    return records, description


def try_out(joints: int, block_s: float, count: int) -> Figures:
    """Send telemetry of joints to a monitor. Return its processor time per second of telemetry.

    The processor time until each joint has its first estimate is measured separately, as
    ``once_s``. Then ``count`` further records are measured.
    """
    with tempfile.TemporaryDirectory(prefix="ema_joints_") as place, closing(Domain()) as domain:
        records, description = recorded_units(Path(place), joints)
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        os.environ["ROS_DOMAIN_ID"] = str(domain.number)
        rclpy.init()
        arguments = {
            "history_folder": f"{place}/history",
            "calibration_file": f"{place}/{{actuator_id}}.yaml",
            "most_actuators": joints,
        }
        parameters = [Parameter(name, value=value) for name, value in arguments.items()]
        node = MonitorNode(parameter_overrides=parameters, namespace=NAMESPACE)
        node.trigger_configure()
        node.trigger_activate()
        estimates: list[FaultEstimate] = []
        node.outputs.estimates.publish = estimates.append  # pyright: ignore[reportAttributeAccessIssue]
        for number in range(joints):
            name, serial = f"joint_{number}", f"{JOINT.upper()}-{number % _UNITS}"
            unit = replace(description, actuator_id=name, serial_number=serial)
            node.receiver.receive_description(description_to_message(unit))
        length_s = len(records[0][0]) * description.sample_period + 2.0 * PAUSE_S
        start_ns = time.time_ns() - round((count + 2) * length_s * 1e9)
        spent_s = once_s = 0.0
        for number in range(count + 2):
            of_units = [record[number % _RECORDS] for record in records]
            at_ns = start_ns + round(number * length_s * 1e9)
            sent = [_messages(record, at_ns, block_s) for record in of_units]
            # The last record only ends the previous one.
            parts = list(zip(*sent, strict=True))[: 1 if number > count else None]
            begin_s = time.process_time()
            for part, blocks in enumerate(parts):
                for joint in range(joints):
                    message = deserialize_message(blocks[joint % _UNITS], TelemetryBlock)
                    message.actuator_id = f"joint_{joint}"
                    node.receiver.receive_telemetry(message)
                while len(node.work.worker.queue):  # in real time the worker would have time
                    time.sleep(0.01)
                if part:
                    continue
                # The first blocks of a record end the previous record.
                end_s = time.monotonic() + _PATIENCE_S
                while len(estimates) < number * joints and time.monotonic() < end_s:
                    time.sleep(0.01)
                if number == 1:  # by then each joint has its first estimate
                    once_s = time.process_time() - begin_s
            spent_s += (time.process_time() - begin_s) * (number > 0)
        spent_s -= once_s
        node.trigger_deactivate()
        rclpy.shutdown()
    invalid = [
        estimate.reason for estimate in estimates if estimate.verdict == FaultEstimate.FAILED
    ]
    return {
        "joints": joints,
        "block_s": block_s,
        "cores": spent_s / (count * length_s),
        "once_s": once_s,
        "estimates": len(estimates),
        "least": (count + 1) * joints,
        "failed": len(invalid),
        "reasons": dict(Counter(invalid).most_common(5)),
        "computing_ms": 1e3
        * float(np.median([estimate.computing_time for estimate in estimates] or [0.0])),
    }


def _messages(record: Telemetry, at_ns: int, block_s: float) -> list[bytes]:
    """Return the full blocks of a record, serialised and shifted to begin at a time [ns]."""
    size = round(block_s / record.sample_period)
    shift = round(at_ns * 1e-9 / record.sample_period)
    moved = replace(record, stamp_ns=at_ns, first_index=shift)
    return [
        serialize_message(telemetry_to_message(moved.part(at, at + size), ""))
        for at in range(0, len(moved) - size + 1, size)
    ]


def measure(pool: Workers, joints: int, blocks: str, records: int) -> Figures:
    """Measure the processor time of one monitor that follows unknown drives."""
    lengths = list(map(float, blocks.split(",")))
    tried = pool.track("block lengths", lengths)
    return {"rows": [in_a_process(try_out, joints, trial, records) for trial in tried]}


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the rows of the targets."""
    first = figures["rows"][0]
    what = f"{first['joints']} unknown drives at 100 Hz, blocks of {first['block_s']:g} s: cores"
    yield at_most(what, first["cores"], MOST_CORES)
    yield at_least(
        "  records estimated", first["estimates"], first["least"], str(first["estimates"])
    )
    yield none_of("  records without an estimate", first["failed"])


def tables(figures: Figures) -> Iterator[Table | str]:
    """Yield the tables to print below the targets."""
    rows_of_joints = figures["rows"]
    names = (name.replace("_", " ") for name in rows_of_joints[0] if name != "reasons")
    shown = ([row[name] for name in row if name != "reasons"] for row in rows_of_joints)
    yield grid("joints of unknown drives", names, shown, digits=3)
    for row in rows_of_joints:
        yield from (
            f"{count} without an estimate: {reason}" for reason, count in row["reasons"].items()
        )


main = command(
    measure,
    "joints of unknown drives",
    rows,
    tables,
    width=150,
    joints=100,
    blocks="0.1,0.01",
    records=2,
)

if __name__ == "__main__":
    main()
