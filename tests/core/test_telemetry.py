# SPDX-License-Identifier: Apache-2.0
"""Telemetry as columns: timestamps, parts, and refused input."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.acquisition import Acquisition
from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry, bridged, join


def telemetry(n: int = 5, **changes) -> Telemetry:
    row = np.arange(n, dtype=float)
    settings = {
        "stamp_ns": 1_000,
        "sample_period": 1e-4,
        "first_index": 1,
        "command": row,
        "current": row + 10.0,
        "position": row + 20.0,
        "speed": row + 30.0,
    }
    return Telemetry(**(settings | changes))


def test_stamps_are_at_the_ends_of_the_samples():
    x = telemetry()
    assert len(x) == 5
    assert x.stamps_ns.tolist() == [1_000 + n * 100_000 for n in range(5)]
    assert x.stamps_ns.dtype == np.int64


RATES_HZ = (3, 4_000, 8_000, 10_000, 25_600, 44_100, 48_000, 51_200, 96_000, 1_000_000)
DAYS_S = 10 * 86_400


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("seed", range(5))
def test_stamp_of_a_sample_does_not_depend_on_the_access(rate_hz, seed):
    """By row, by sample and from any part, at indices of up to ten days."""
    rng = np.random.default_rng(seed)
    first_index = int(rng.integers(DAYS_S * rate_hz))
    x = telemetry(60, stamp_ns=1_751_234_567_123_456_789, first_index=first_index)
    x = replace(x, sample_period=1.0 / rate_hz)
    stamps = [x.stamp_at(sample) for sample in range(len(x))]
    assert x.stamps_ns.tolist() == stamps
    start, stop = np.sort(rng.choice(len(x) + 1, 2, replace=False)).tolist()
    part = x.part(start, stop)
    assert part.stamps_ns.tolist() == stamps[start:stop]
    assert [part.stamp_at(sample) for sample in range(len(part))] == stamps[start:stop]


def test_part_carries_its_own_stamp_and_index():
    part = telemetry().part(2, 4)
    assert part.stamp_ns == 201_000
    assert part.first_index == 3
    assert part.command.tolist() == [2.0, 3.0]
    assert part.current.tolist() == [12.0, 13.0]
    assert part.position.tolist() == [22.0, 23.0]
    assert part.speed.tolist() == [32.0, 33.0]


@pytest.mark.parametrize(("start", "stop"), [(-2, 5), (5, 5), (0, 10_000)])
def test_invalid_part_is_refused(start, stop):
    row = np.zeros(10)
    with pytest.raises(ValueError, match=r"out of range: there are 10 samples"):
        Telemetry(0, 1e-4, 1, row, row, row, row).part(start, stop)


def test_unmeasured_columns_are_empty_but_the_position_is_required():
    x = telemetry(command=np.empty(0), speed=np.empty(0))
    assert (len(x), x.has_command, x.missing) == (5, False, ("command", "speed"))
    part = x.part(1, 3)
    assert (len(part), len(part.command), part.position.tolist()) == (2, 0, [21.0, 22.0])
    assert telemetry().has_command
    with pytest.raises(
        ValueError,
        match="position 0, speed 5, payload 0; only command, current, speed, payload may",
    ):
        telemetry(position=np.empty(0))


def test_only_a_drive_with_an_unknown_controller_may_lack_a_command():
    acquisition = Acquisition(command=False)
    assert str(acquisition) == "current mean, speed measured, no command"
    assert acquisition.contradicting(("command",)) == ((), ())
    assert acquisition.contradicting(()) == ((), ("command",))
    assert not ActuatorDescription(drive="unknown", acquisition=acquisition).acquisition.command
    with pytest.raises(ValueError, match="no position command with drive = six_step"):
        ActuatorDescription(acquisition=acquisition)


def test_payload_stays_with_its_samples_and_is_held_over_lost_samples():
    row = np.arange(5.0)
    x = telemetry(payload=np.array([0.0, 0.0, 2.0, 2.0, 2.0]), sample_period=0.01)
    assert (x.has_payload, telemetry().has_payload) == (True, False)
    assert x.part(1, 3).payload.tolist() == [0.0, 2.0]
    later = replace(x, stamp_ns=x.stamp_at(7), first_index=8, payload=np.zeros(5))
    [first, lost, last] = bridged([x, later])
    assert lost.payload.tolist() == [2.0, 2.0]
    assert join([first, lost, last]).payload.tolist() == [0, 0, 2, 2, 2, 2, 2, 0, 0, 0, 0, 0]
    assert len(list(bridged([x, replace(later, payload=np.empty(0))]))) == 2
    with pytest.raises(ValueError, match="payload 3"):
        telemetry(payload=row[:3])
