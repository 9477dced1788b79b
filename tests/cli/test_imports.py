# SPDX-License-Identifier: Apache-2.0
"""Commands import only what they need, so that they start quickly."""

import json
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from tests.monitor.joint.plant import Joint, Sensors, telemetry_of, tones

from ..commands import SAMPLE

LIST_IMPORTS = """
import sys
from ema_cli.main import main
for options in [], ["--json"][: sys.argv[1] == "estimate"]:
    main([*sys.argv[1:], *options], standalone_mode=False)
print(*sys.modules)
"""
# numba itself imports scipy, to check its version.
PICTURES_TABLES_ROS = {"matplotlib", "pandas", "jinja2", "scipy.special", "rclpy", "sqlite3"}


def imported(*arguments: str | Path) -> set[str]:
    """Return the names of the modules that a command has imported when it ends."""
    done = subprocess.run(
        [sys.executable, "-c", LIST_IMPORTS, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=True,
    )
    return set(done.stdout.splitlines()[-1].split())


def test_help_imports_no_command():
    modules = imported("--help")
    ours = {name for name in modules if name.startswith("ema_")}
    core = {"ema_core", "ema_core.array_environment", "ema_core.start"}
    assert ours == {"ema_cli", "ema_cli.main"} | core
    assert not modules & {"numpy", "rich", "yaml"}


def test_info_imports_neither_a_compiler_nor_libraries_for_tables_and_bars():
    modules = imported("info", SAMPLE)
    assert not modules & (PICTURES_TABLES_ROS | {"numba", "rich", "yaml", "numpy.random"})
    assert not any(name.startswith("ema_monitor.identification") for name in modules)


def test_estimate_imports_no_pictures_no_node_and_no_prognosis():
    # numba imports sqlite3 if coverage is installed.
    modules = imported("estimate", SAMPLE)
    assert not modules & (PICTURES_TABLES_ROS - {"sqlite3"})
    assert not any(name.startswith(("ema_monitor.prognosis", "ema_sim")) for name in modules)


MAPPING = """
position: {source: position}
current: {source: current, unit: A}
clock: {source: time}
"""


@pytest.fixture(scope="module")
def tables(ema, tmp_path_factory):
    """Return a folder with records of a joint as CSV and Parquet files, and their calibration."""
    folder = tmp_path_factory.mktemp("joint")
    (folder / "mapping.yaml").write_text(MAPPING)
    (folder / "actuator.yaml").write_text("actuator_id: a\nserial_number: A-1\ndrive: unknown\n")
    for name, day, friction in [
        *((f"healthy_{i}", i, 1.0) for i in range(6)),
        ("usual", 6, 1.0),
        ("test", 30, 1.3),
    ]:
        joint = Joint().times(coulomb=friction)
        record = telemetry_of(joint, tones(30.0), Sensors(), seed=day, day=day)
        columns = {"position": record.position, "current": record.current}
        frame = pd.DataFrame({"time": record.stamps_ns * 1e-9, **columns})
        frame.to_csv(folder / f"{name}.csv", index=False)
        frame.to_parquet(folder / f"{name}.parquet", index=False)
    healthy = sorted(folder.glob("healthy_*.csv"))
    made = ema("calibrate", *healthy, "-o", folder / "calibration.yaml")
    assert made.exit_code == 0, made.output
    return folder


@pytest.mark.parametrize("name", ["usual.csv", "usual.parquet"])
def test_estimate_of_a_table_imports_no_compiler_no_pandas_and_no_bag(tables, name):
    modules = imported("estimate", tables / name)
    unwanted = {"numba", "pandas", "rclpy", "mcap", "rosbags", "numpy.random"}
    assert not modules & unwanted
    assert "ema_monitor.joint.comparing" in modules


@pytest.mark.parametrize("name", ["test.csv", "test.parquet"])
def test_table_and_its_imported_bag_give_the_same_estimate(ema, tables, name):
    bag, mapping = tables / f"{name}.mcap", tables / "mapping.yaml"
    options = ("--mapping", mapping, "--actuator", tables / "actuator.yaml")
    assert ema("import", tables / name, *options, "-o", bag).exit_code == 0
    of_table, of_bag = (
        json.loads(ema("estimate", path, "--json").stdout) for path in (tables / name, bag)
    )
    for estimate in (*of_table, *of_bag):
        estimate.pop("computing_time")
    assert of_table == of_bag
    assert of_table[0]["comparison"]["quantities"][0]["judgement"] == "changed"
