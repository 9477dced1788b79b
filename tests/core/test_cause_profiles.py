"""Hidden causes as texts and as courses in time."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from ema_core.cause_profiles import Profile, cause_profiles
from ema_core.causes import CAUSES

DOCUMENT = Path(__file__).parents[2] / "docs" / "faults.md"


@pytest.mark.parametrize(
    ("text", "name", "profile"),
    [
        ("load_torque=0.01", "load_torque", Profile(0.01)),
        ("load_torque=-1e-2", "load_torque", Profile(-0.01)),
        (" Load torque = 0.01 ", "load_torque", Profile(0.01)),
        ("current_offset=0.1@3.0", "current_offset", Profile(0.1, 3.0, 3.0)),
        ("current_offset=.1@.5", "current_offset", Profile(0.1, 0.5, 0.5)),
        ("winding_temperature=80@0..10", "winding_temperature", Profile(80.0, 0.0, 10.0)),
        ("winding_temperature=80@1e-1..2.5", "winding_temperature", Profile(80.0, 0.1, 2.5)),
        ("jam=1@2", "jam", Profile(1.0, 2.0, 2.0)),
    ],
)
def test_text_is_a_profile(text, name, profile):
    assert cause_profiles([text]) == {name: profile}


def test_profile_is_zero_before_linear_between_and_constant_after():
    times = [0.0, 0.999, 1.0, 2.0, 3.0, 9.0]
    np.testing.assert_allclose(Profile(5.0).at(times), 5.0, rtol=0)
    np.testing.assert_array_equal(Profile(5.0, 1.0, 1.0).at(times), [0, 0, 5, 5, 5, 5])
    np.testing.assert_allclose(Profile(-5.0, 1.0, 3.0).at(times), [0, 0, 0, -2.5, -5, -5])


@pytest.mark.parametrize(
    ("causes", "parts"),
    [
        (["load_torqe=1"], ("'load_torqe'", "did you mean 'load_torque'", "jam")),
        ({"load_torqe": 1.0}, ("'load_torqe'", "did you mean 'load_torque'")),
        (["load_torque"], ("'load_torque'", "NAME=VALUE[@START[..END]]")),
        (["load_torque="], ("'load_torque='", "NAME=VALUE")),
        (["load_torque=x"], ("load_torque = x N.m", "not a number", "NAME=VALUE")),
        (["load_torque=1@x"], ("start x s", "not a number")),
        (["load_torque=1@0..x"], ("end x s", "not a number")),
        (["load_torque=1@0..1@2"], ("'load_torque=1@0..1@2'", "NAME=VALUE")),
        (["load_torque=99"], ("load_torque = 99 N.m", "[-10, 10] N.m")),
        (["load_torque=nan"], ("load_torque = nan", "[-10, 10] N.m")),
        (["dead_time=1"], ("dead_time = 1 s", "[0, 2e-05] s")),
        (["load_torque=1@-1"], ("load_torque", "start = -1.0 s", "at least 0 s")),
        (["load_torque=1@nan"], ("load_torque", "start = nan s")),
        (["load_torque=1@5..2"], ("end 2 s", "start 5 s")),
        (["load_torque=1@5..5"], ("end 5 s", "start 5 s")),
        (["load_torque=1@0..inf"], ("load_torque", "end = inf s")),
        (["jam=0.5"], ("jam = 0.5", "0 or 1")),
        (["jam=1@0..2"], ("jam", "without a ramp")),
        (["jam=1", "jam=0"], ("jam", "more than once")),
        ({"load_torque": True}, ("load_torque = True",)),
        ({"load_torque": "0.1"}, ("load_torque = '0.1'",)),
        ({"load_torque": Profile(1.0, 3.0, 2.0)}, ("end = 2 s", "start = 3 s")),
        ("load_torque=1", ("'load_torque=1'", "list")),
        ([math.pi], ("3.14", "NAME=VALUE")),
    ],
)
def test_impossible_cause_is_refused_by_name_value_and_range(causes, parts):
    with pytest.raises(ValueError, match=re.escape(parts[0])) as refusal:
        cause_profiles(causes)
    for part in parts[1:]:
        assert part in str(refusal.value)


def test_document_shows_the_registry():
    lines = DOCUMENT.read_text(encoding="utf-8").splitlines()
    begin = lines.index("| name | where | unit | range | meaning |") + 2
    assert lines[begin : begin + len(CAUSES)] == [
        f"| {cause.name} | {cause.place.value} | {cause.unit} | {cause.lowest:g} to "
        f"{cause.highest:g} | {cause.meaning} |"
        for cause in CAUSES
    ]
