# SPDX-License-Identifier: Apache-2.0
"""Times as people write them: read exactly or refused, but never dropped."""

import numpy as np
import pandas as pd
import pytest

from ema_bags.inputs.files import open_input
from ema_bags.inputs.importing import import_series
from ema_bags.inputs.mapping import Clock
from ema_bags.inputs.tables import read_columns

from .conftest import described
from .remarks import remarks_of

DAY = pd.Timestamp("2026-10-23T08:15:00")
LOST = range(700, 709)


def frame_of(telemetry):
    """Return the times without some rows, and the columns of these rows."""
    moments = DAY + pd.to_timedelta(telemetry.stamps_ns - telemetry.stamps_ns[0], unit="ns")
    columns = {"command": telemetry.command, "position": telemetry.position}
    frame = pd.DataFrame(columns | {"speed": telemetry.speed, "current": telemetry.current})
    kept = np.setdiff1d(np.arange(len(frame)), LOST)
    return moments[kept], frame.iloc[kept].reset_index(drop=True)


def texts(moments, style):
    return [moment.strftime(style) for moment in moments]


def milliseconds(moments, style, separator="."):
    return [f"{m.strftime(style)}{separator}{m.microsecond // 1000:03d}" for m in moments]


SINCE = (DAY - pd.Timestamp("1970-01-01")).total_seconds()
NUMBERS = {
    "Time [min]": (1 / 60, 0.0),
    "time (h)": (1 / 3600, 0.0),
    "Time [days]": (1 / 86400, 0.0),
    "Excel time": (1 / 86400, 25569),
    "Matlab time": (1 / 86400, 719529),
    "LabVIEW time": (1.0, 2082844800),
    "LabVIEW time [s]": (1.0, 2082844800),
    "FILETIME timestamp": (1e7, 116444736000000000),
    "ticks time": (1e7, 621355968000000000),
}
UNITS = {
    "Time [min]": "min",
    "time (h)": "h",
    "Time [days]": "day",
    "Excel time": "excel_day",
    "Matlab time": "matlab_day",
    "LabVIEW time": "s_1904",
    "LabVIEW time [s]": "s_1904",
    "FILETIME timestamp": "filetime",
    "ticks time": "dotnet_ticks",
}


def imported(path, telemetry):
    """Return the telemetry of a table with its guessed mapping."""
    source = open_input(path)
    description = described(1000)
    mapping = source.guess(description).mapping
    return mapping, import_series(source.series(mapping), mapping, description)


def check(recording, *, has_date=True):
    """Check rate and lost rows against the record, and the date if there is one."""
    assert recording.rate.period == 1e-3
    assert (recording.stream.losses.lost, recording.stream.losses.gaps) == (len(LOST), 1)
    if has_date:
        first = recording.runs[0].stamps_ns[0]
        assert abs(first - DAY.value) < 1_000_000


@pytest.mark.parametrize(
    "styled",
    [
        lambda t: milliseconds(t, "%d.%m.%Y %H:%M:%S"),
        lambda t: milliseconds(t, "%d.%m.%Y %H:%M:%S", ","),
        lambda t: milliseconds(t, "%d.%m.%y %H:%M:%S"),
        lambda t: milliseconds(t, "%d/%m/%Y %H:%M:%S", ":"),
        lambda t: milliseconds(t, "%m/%d/%Y %H:%M:%S"),
        lambda t: [f"{text} AM" for text in milliseconds(t, "%m/%d/%Y %I:%M:%S")],
        lambda t: milliseconds(t, "%d-%b-%Y %H:%M:%S"),
        lambda t: milliseconds(t, "%d %b %Y %H:%M:%S"),
        lambda t: milliseconds(t, "%Y/%m/%d %H:%M:%S"),
        lambda t: milliseconds(t, "%Y-%m-%d %H:%M:%S", ","),
        lambda t: milliseconds(t, "%Y%m%dT%H%M%S"),
        lambda t: [f"{text}+02:00" for text in milliseconds(t + pd.Timedelta("2h"), "%Y-%m-%d %T")],
    ],
)
@pytest.mark.parametrize("is_parquet", [False, True])
def test_dates_of_other_countries_and_programs_are_read(telemetry, tmp_path, styled, is_parquet):
    moments, frame = frame_of(telemetry)
    frame.insert(0, "Zeit", styled(moments))
    path = tmp_path / ("a.parquet" if is_parquet else "a.csv")
    if is_parquet:
        frame.to_parquet(path)
    else:
        frame.to_csv(path, index=False, sep=";", decimal=",")
    mapping, recording = imported(path, telemetry)
    assert mapping.clock == Clock("Zeit", "ns")
    check(recording)


@pytest.mark.parametrize(
    ("date", "time"), [("%d.%m.%Y", "%H:%M:%S"), ("%m/%d/%Y", "%I:%M:%S"), ("%Y-%m-%d", "%H:%M:%S")]
)
def test_date_and_time_in_separate_columns_are_added(telemetry, tmp_path, date, time):
    moments, frame = frame_of(telemetry)
    half = " AM" if "%I" in time else ""
    frame.insert(0, "Datum", texts(moments, date))
    frame.insert(1, "Uhrzeit", [f"{text}{half}" for text in milliseconds(moments, time)])
    frame.to_csv(tmp_path / "a.csv", index=False)
    mapping, recording = imported(tmp_path / "a.csv", telemetry)
    assert mapping.clock == Clock("Datum + Uhrzeit", "ns")
    check(recording)


@pytest.mark.parametrize("name", NUMBERS)
def test_units_and_epochs_of_numbers_are_recognised(telemetry, tmp_path, name):
    moments, frame = frame_of(telemetry)
    size, epoch = NUMBERS[name]
    since = (moments - pd.Timestamp("1970-01-01")).total_seconds().to_numpy()
    if epoch:
        values = since * size + epoch
    else:
        values = (since - SINCE) * size
    if size > 1.0:
        ns = np.array([moment.value for moment in moments])
        values = ns // 100 + epoch
    frame.insert(0, name, values)
    frame.to_csv(tmp_path / "a.csv", index=False, float_format="%.14g" if epoch else None)
    if epoch and size <= 1.0:
        frame[name] = [f"{value:.16g}" for value in values]
        frame.to_csv(tmp_path / "a.csv", index=False)
    mapping, recording = imported(tmp_path / "a.csv", telemetry)
    assert mapping.clock == Clock(name, UNITS[name])
    check(recording, has_date=bool(epoch))


@pytest.mark.parametrize("name", [None, "seconds", "index"])
def test_numeric_index_of_a_parquet_frame_is_its_time(telemetry, tmp_path, name):
    moments, frame = frame_of(telemetry)
    frame.index = pd.Index((moments - DAY).total_seconds(), name=name)
    frame.to_parquet(tmp_path / "a.parquet")
    mapping, recording = imported(tmp_path / "a.parquet", telemetry)
    assert mapping.clock == Clock(name or "index", "s")
    check(recording, has_date=False)


def test_times_of_day_continue_after_midnight(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time;p\n23:59:59.998;0.5\n23:59:59.999;0.5\n00:00:00.000;0.5\n")
    stamps = read_columns(path).stamps(Clock("time"))
    assert list(np.diff(stamps)) == [1_000_000, 1_000_000]


def test_minutes_and_seconds_are_read(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time;p\n59:59.5;0.5\n61:00.25;0.5\n")
    assert list(read_columns(path).stamps(Clock("time"))) == [3_599_500_000_000, 3_660_250_000_000]


def test_date_with_ambiguous_day_and_month_is_refused_until_its_order_is_given(telemetry, tmp_path):
    moments, frame = frame_of(telemetry)
    frame.insert(0, "Date", milliseconds(moments - pd.Timedelta(days=18), "%d/%m/%Y %H:%M:%S"))
    path = tmp_path / "a.csv"
    frame.to_csv(path, index=False)
    source = open_input(path)
    with pytest.raises(
        ValueError,
        match=r"'Date', the order of day and month is ambiguous: row 1: '05/10/2026 08:15:00\.000'",
    ):
        source.guess(described(1000))
    first = [
        pd.Timestamp(source.series(source.guess(described(1000), clock).mapping)[""].stamps_ns[0])
        for clock in (Clock("Date", "d/m/y"), Clock("Date", "m/d/y"))
    ]
    assert [(day.month, day.day) for day in first] == [(10, 5), (5, 10)]


@pytest.mark.parametrize(
    ("name", "cells", "words"),
    [
        ("Time [ticks]", lambda n: np.arange(n) * 0.5, "unknown time unit 'ticks'"),
        ("Zeit", lambda n: ["yesterday"] * n, "its cells are not times: 'yesterday'"),
        ("Time", lambda n: [f"12:00:{i // 1000:02d}" for i in range(n)], "changes in only"),
        (
            "Time",
            lambda n: ["12:00:00.5", *["12 o'clock 5"] * 3, *["12:00:01.5"] * (n - 4)],
            "row 2",
        ),
        ("Date", lambda n: ["05.01.2026"] * n, "never changes"),
    ],
)
def test_unreadable_time_column_is_refused_instead_of_assuming_a_rate(
    telemetry, tmp_path, name, cells, words
):
    _, frame = frame_of(telemetry)
    frame.insert(0, name, cells(len(frame)))
    frame.to_csv(tmp_path / "a.csv", index=False)
    with pytest.raises(ValueError, match=words):
        open_input(tmp_path / "a.csv").guess(described(1000))


def test_row_number_is_not_a_time(telemetry, tmp_path):
    _, frame = frame_of(telemetry)
    frame.insert(0, "number", np.arange(len(frame)))
    frame.to_csv(tmp_path / "a.csv", index=False)
    guess = open_input(tmp_path / "a.csv").guess(described(1000))
    assert guess.mapping.clock == Clock(rate_hz=1000.0)


def test_temperature_named_t_is_not_a_time(telemetry, tmp_path):
    moments, frame = frame_of(telemetry)
    frame.insert(0, "T [degC]", 20.0)
    frame.insert(1, "stamp", milliseconds(moments, "%d.%m.%Y %H:%M:%S"))
    frame.to_csv(tmp_path / "a.csv", index=False)
    assert open_input(tmp_path / "a.csv").guess(described(1000)).mapping.clock.source == "stamp"


def moving(times, **more):
    angle = 0.3 * np.sin(0.01 * np.arange(len(times)))
    return pd.DataFrame({"Time": times, "position": angle, "command": angle} | more)


@pytest.mark.parametrize("fraction", [0.0, 0.004])
def test_date_written_as_a_number_is_refused_with_the_expected_form(tmp_path, fraction):
    times = 20260330080000 + np.arange(50) // 5 + fraction
    moving(times).to_csv(tmp_path / "a.csv", index=False, float_format="%.17g")
    with pytest.raises(ValueError, match=r"column 'Time': 20260330080000.* date written as a num"):
        open_input(tmp_path / "a.csv").guess(described(1000))


@pytest.mark.parametrize("unit_s", [60.0, 3600.0])
def test_minutes_and_hours_without_a_unit_are_not_mistaken_for_seconds(tmp_path, unit_s):
    moving(0.005 * np.arange(500) / unit_s).to_csv(tmp_path / "a.csv", index=False)
    with pytest.raises(ValueError, match=r"column 'Time' has no unit, .* set clock\.unit"):
        open_input(tmp_path / "a.csv").guess(described(1000))


def test_julian_days_require_their_unit(tmp_path):
    moving(61000.25 + 0.005 / 86400 * np.arange(500)).rename(columns={"Time": "MJD"}).to_csv(
        tmp_path / "a.csv", index=False, float_format="%.12f"
    )
    with pytest.raises(ValueError, match=r"column 'MJD' has no unit, .* such as min, h or day"):
        open_input(tmp_path / "a.csv").guess(described(1000))


@pytest.mark.parametrize("name", ["Row", "Setpoint [deg]"])
def test_column_with_another_unit_is_not_mistaken_for_a_time(tmp_path, name):
    frame = moving(np.arange(300)).rename(columns={"Time": name, "command": "cmd [deg]"})
    frame.to_csv(tmp_path / "a.csv", index=False)
    guess = open_input(tmp_path / "a.csv").guess(described(1000))
    assert "no column was recognized as the time" in "; ".join(remarks_of(guess))


@pytest.mark.parametrize("wrong", ["1970-01-01T00:00:00", "2106-02-07T06:28:00"])
@pytest.mark.parametrize("at", [0, 100, 299])
def test_stamp_far_from_all_others_is_rebuilt(tmp_path, wrong, at):
    times = pd.Timestamp("2026-10-20T08:00") + pd.to_timedelta(5 * np.arange(300), unit="ms")
    stamps = times.strftime("%Y-%m-%dT%H:%M:%S.%f").to_numpy(object)
    stamps[at] = wrong
    moving(stamps).to_csv(tmp_path / "a.csv", index=False)
    source = open_input(tmp_path / "a.csv")
    series = source.series(source.guess(described(200)).mapping)[""]
    stamped, rebuilt = series.stamped()
    assert rebuilt == 1
    assert np.all(np.abs(np.diff(stamped) - 5_000_000) <= 5_000_000)
