# SPDX-License-Identifier: Apache-2.0
"""A measured temperature next to telemetry: units, one value per second, and refused values."""

from types import SimpleNamespace

import numpy as np
import pytest

from ema_bags.inputs.bridging import Bridge, BridgeSettings
from ema_bags.inputs.defect_wording import defect_text
from ema_bags.inputs.defects import refused
from ema_bags.inputs.importing import import_series
from ema_bags.inputs.series import Series

from .conftest import mapping_from
from .joint_motion import START_NS, joint, moves

SECOND_NS = 1_000_000_000
RATE_HZ = 200.0


def series(celsius, factor=1.0, addition=0.0):
    columns, stamps = moves(12.0, RATE_HZ)
    names = {"position": "position", "speed": "speed", "current": "current", "command": "command"}
    values = {key: columns[name] for key, name in names.items()}
    return Series(stamps, stamps, values | {"temperature": factor * celsius + addition})


def imported(mapped, of, **section):
    mapping = mapped(temperature={"source": "T", **section})
    return import_series({"": of}, mapping, joint(RATE_HZ))


def warming(n=2400):
    return np.linspace(30.0, 31.2, n)


@pytest.mark.parametrize(
    ("unit", "factor", "addition"), [("degC", 1.0, 0.0), ("K", 1.0, 273.15), ("degF", 1.8, 32.0)]
)
def test_temperature_in_any_unit_is_a_rise_over_20_celsius_once_per_second(
    mapped, unit, factor, addition
):
    recording = imported(mapped, series(warming(), factor, addition), unit=unit)
    assert refused(recording.defects, recording.mapping) == []
    assert len(recording.rises) == 13  # 12 s that begin within a second
    assert recording.rises[0].stamp_ns == recording.runs[0].stamps_ns[0]
    assert np.all(np.diff([rise.stamp_ns for rise in recording.rises[1:]]) == SECOND_NS)
    assert recording.rises[0].rise == pytest.approx(10.0, abs=1e-6)
    assert recording.rises[-1].rise == pytest.approx(11.2, abs=0.11)
    assert recording.rises[0].cause.name == "winding_temperature"


def test_temperature_has_a_scale_and_an_offset(mapped):
    recording = imported(mapped, series(warming(), 10.0), scale=0.1, offset=-2.0)
    assert recording.rises[0].rise == pytest.approx(8.0)


def test_telemetry_does_not_depend_on_a_temperature(mapped):
    of = series(warming())
    recording, plain = imported(mapped, of), import_series({"": of}, mapped(), joint(RATE_HZ))
    assert len(recording.runs) == len(plain.runs) == 1
    np.testing.assert_array_equal(recording.runs[0].values, plain.runs[0].values)
    assert plain.rises == []


def test_sensor_that_is_read_every_few_seconds_loses_no_sample(mapped):
    celsius = np.full(2400, np.nan)
    celsius[700::1000] = [25.0, 26.0]
    recording = imported(mapped, series(celsius))
    assert [rise.rise for rise in recording.rises] == pytest.approx([5.0, 5.0, 6.0])
    stamps = recording.runs[0].stamps_ns
    assert [rise.stamp_ns for rise in recording.rises] == [stamps[0], stamps[700], stamps[1700]]
    assert len(stamps) == 2400


def test_sensor_that_starts_late_has_no_values_before_its_first_reading(mapped):
    celsius = np.full(2400, np.nan)
    celsius[2300] = 25.0
    recording = imported(mapped, series(celsius))
    assert [rise.stamp_ns for rise in recording.rises] == [recording.runs[0].stamps_ns[2300]]


def test_kelvin_read_as_celsius_is_an_error_that_names_the_unit(mapped):
    recording = imported(mapped, series(warming(), 1.0, 273.15))
    [defect] = refused(recording.defects, recording.mapping)
    assert defect.kind == "temperature_range"
    assert "temperature 304.3 degC, expected -130 to 270" in defect_text(defect).problem
    assert "temperature: {unit: K}" in defect_text(defect).remedy
    assert recording.rises == []


def test_failed_readings_are_left_out(mapped):
    celsius = warming()
    celsius[::400] = -999.0
    of = series(celsius)
    mapping = mapped(temperature="T", accept=["temperature_range"])
    recording = import_series({"": of}, mapping, joint(RATE_HZ))
    assert refused(recording.defects, mapping) == []
    assert min(rise.rise for rise in recording.rises) > 9.9


STATES, TEMPERATURE = "/joint_states", "/temperature"


def bridge_of(temperature):
    of_state = {name: {"topic": STATES, "source": name} for name in ("position", "speed")}
    mapping = {
        **of_state,
        "current": {"topic": STATES, "source": "current"},
        "temperature": temperature,
    }
    return Bridge(mapping_from(mapping), joint(RATE_HZ), BridgeSettings())


def driven(bridge, send=None, **fields):
    """Send 4 s of states; return the telemetry samples and rises of the last 1 s."""
    columns, stamps = moves(4.0, RATE_HZ)
    blocks, rises, late = [], [], []
    for i, stamp in enumerate(stamps.tolist()):
        if send is not None and i % 300 == 0:  # every 1.5 s
            send(bridge, stamp, 40.0 + i / 100.0)
        header = SimpleNamespace(stamp=SimpleNamespace(sec=stamp // 10**9, nanosec=stamp % 10**9))
        values = {name: float(columns[name][i]) for name in ("position", "speed", "current")}
        bridge.collector.add(
            STATES, SimpleNamespace(header=header, **values, **fields), stamp, stamp
        )
        if i % 2 == 0:
            blocks += bridge.advance()
            rises += bridge.take_rises()
            if bridge.rate is not None:
                late.append(i + 1 - sum(map(len, blocks)))
    return blocks, rises, late


def test_bridge_reads_the_temperature_of_the_same_message():
    bridge = bridge_of({"topic": STATES, "source": "motor_temperature"})
    _, rises, late = driven(bridge, motor_temperature=33.0)
    assert [rise.rise for rise in rises] == [13.0] * len(rises)
    assert len(rises) >= 4
    assert max(late) <= 1


def test_bridge_does_not_wait_for_a_slow_temperature_of_another_topic():
    def send(bridge, stamp, celsius):
        header = SimpleNamespace(stamp=SimpleNamespace(sec=stamp // 10**9, nanosec=stamp % 10**9))
        message = SimpleNamespace(header=header, temperature=celsius)
        bridge.collector.add(TEMPERATURE, message, stamp, stamp)

    bridge = bridge_of({"topic": TEMPERATURE, "source": "temperature"})
    blocks, rises, late = driven(bridge, send)
    assert sum(map(len, blocks)) >= 799
    assert max(late) <= 1
    assert rises[0].stamp_ns == START_NS + 5_000_000
    assert sorted({rise.rise for rise in rises}) == pytest.approx([20.0, 23.0])


def test_bridge_reports_an_impossible_temperature_and_withholds_nothing():
    bridge = bridge_of({"topic": STATES, "source": "motor_temperature"})
    blocks, rises, _ = driven(bridge, motor_temperature=306.0)
    assert rises == []
    assert [defect.kind for defect in bridge.uncertain] == ["temperature_range"]
    assert sum(map(len, blocks)) >= 799
