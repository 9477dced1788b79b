# SPDX-License-Identifier: Apache-2.0
"""The interface package is complete and documented, and messages survive serialisation."""

import re
from dataclasses import fields
from pathlib import Path

import pytest

from ema_core.commands import Command
from ema_core.faults import N_FAULTS
from ema_core.levels import ERROR, OK, STALE, WARN
from ema_interfaces.msg import FaultEstimate, FaultHealth, FaultVector, Health
from ema_interfaces.srv import SetCommand, SetSimulatedFaults

PACKAGE = Path(__file__).parents[2] / "ema_interfaces"
DEFINITIONS = sorted(PACKAGE.glob("*/*.msg")) + sorted(PACKAGE.glob("*/*.srv"))
DEFINITIONS += sorted(PACKAGE.glob("*/*.action"))


def relative(path: Path) -> str:
    return str(path.relative_to(PACKAGE))


@pytest.mark.parametrize("path", DEFINITIONS, ids=relative)
def test_every_field_has_a_comment_above_it_that_ends_with_its_unit(path: Path):
    lines = path.read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("# "), "the first line describes the interface"
    fields = [n for n, line in enumerate(lines) if line.strip() and line[0] not in "#-"]
    assert fields
    assert [lines[n] for n in fields if not lines[n - 1].startswith("# ")] == []
    # `ros2 interface show` prints a bare "#" if a comment with a unit follows the field.
    assert [line for line in lines if "#" in line and not line.startswith("# ")] == []
    assert [line for line in lines if len(line) > 100] == []
    # The parser of rosidl removes the unit from the comment.
    comments = [line for line in lines if line.startswith("#")]
    assert [line for line in comments if re.search(r"# \[[^,\]]+\]$|\[[^,\]]+\] *\S", line)] == []


def test_unset_messages_are_healthy_and_no_valid_result():
    healthy = FaultVector()
    assert (healthy.gain, healthy.eccentricity_phase, healthy.friction) == (0.5, 0.5, 0.0)
    assert SetSimulatedFaults.Request().faults == healthy
    assert (Health().level, FaultHealth().level) == (Health.STALE, FaultHealth.STALE)
    assert FaultEstimate().verdict == FaultEstimate.REFUSED
    levels = [Health.OK, Health.WARN, Health.ERROR, Health.STALE]
    assert levels == [OK, WARN, ERROR, STALE]
    grades = ("NONE", "LOW", "MODERATE", "HIGH", "END")
    assert [getattr(Health, f"SEVERITY_{name}") for name in grades] == [0, 1, 2, 3, 4]


def test_unset_command_is_the_default_command():
    request, default = SetCommand.Request(), Command()
    for field in fields(Command):
        if field.name != "samples":
            assert getattr(request, field.name) == getattr(default, field.name), field.name


def test_observability_bits_follow_the_order_of_the_fault_vector():
    names = list(FaultVector.get_fields_and_field_types())
    assert [getattr(FaultEstimate, name.upper()) for name in names] == [
        1 << i for i in range(N_FAULTS)
    ]
