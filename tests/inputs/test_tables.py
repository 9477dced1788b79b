# SPDX-License-Identifier: Apache-2.0
"""Tables as test engineers write them, and the mapping guessed from them."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from ema_bags.inputs import csv_file, parquet_file
from ema_bags.inputs.files import open_input
from ema_bags.inputs.mapping import Clock, Table
from ema_bags.inputs.series import NO_STAMP
from ema_bags.inputs.table_columns import stamps_of
from ema_bags.inputs.table_series import table_series
from ema_bags.inputs.tables import read_columns

from .conftest import described, mapping_from
from .remarks import remarks_of

VALUES = np.array([[0.0, 1.5, -2.25], [0.001, 1.625, 3.125e-7], [0.002, 1.75, 12345.678]])


def written(path, text, encoding="utf-8"):
    path.write_text(text, encoding=encoding)
    return path


def rows(separator, decimal="."):
    lines = [separator.join(repr(float(v)).replace(".", decimal) for v in row) for row in VALUES]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("separator", "decimal"),
    [(",", "."), (";", "."), (";", ","), ("\t", ","), ("\t", "."), (" ", "."), ("|", ".")],
)
def test_separator_and_decimal_sign_are_detected(tmp_path, separator, decimal):
    head = separator.join(["t", "pos", "cur"])
    path = written(tmp_path / "a.csv", f"{head}\n{rows(separator, decimal)}")
    columns = read_columns(path)
    assert list(columns.values) == ["t", "pos", "cur"]
    assert np.array_equal(np.column_stack(list(columns.values.values())), VALUES)
    assert columns.format == Table(separator, decimal)


def test_units_are_in_names_or_in_a_separate_line(tmp_path):
    path = written(tmp_path / "a.csv", f"t [ms];pos (deg);cur\n{rows(';')}")
    assert read_columns(path).units == {"t [ms]": "ms", "pos (deg)": "deg"}
    path = written(tmp_path / "b.csv", f"t;pos;cur\n[ms];[deg];[A]\n{rows(';')}")
    columns = read_columns(path)
    assert columns.units == {"t": "ms", "pos": "deg", "cur": "A"}
    assert len(columns) == 3


def test_preamble_and_comments_are_skipped(tmp_path):
    text = f"Recorder 4.2\nserial 0815\n\n# t, pos, cur\n{rows(',')}"
    assert list(read_columns(written(tmp_path / "a.csv", text)).values) == ["t", "pos", "cur"]


@pytest.mark.parametrize("encoding", ["utf-8-sig", "latin-1", "utf-16"])
def test_encodings_of_spreadsheets_are_read(tmp_path, encoding):
    path = written(tmp_path / "a.csv", f"t;Öl [°];cur\n{rows(';', ',')}", encoding)
    assert read_columns(path).units["Öl [°]"] == "°"


def test_empty_cells_become_nan_and_texts_are_no_columns(tmp_path):
    path = written(tmp_path / "a.csv", "t;pos;state\n0;1,5;on\n1;;on\n2;3,5;no\n3;x;no\n4;5,5;no\n")
    columns = read_columns(path)
    assert list(columns.texts["state"]) == ["on", "on", "no", "no", "no"]
    assert str(columns.values["pos"]) == "[1.5 nan 3.5 nan 5.5]"
    with pytest.raises(ValueError, match="column 'state' contains no numbers"):
        columns.column("state")
    with pytest.raises(ValueError, match="unknown column 'poss'; did you mean 'pos'"):
        columns.column("poss")


@pytest.mark.parametrize("text", ["", "hello\nworld\n", "\0\1\2\3"])
def test_file_that_is_not_a_table_is_refused(tmp_path, text):
    with pytest.raises(ValueError, match=r"a\.csv is (not a t|empty)"):
        read_columns(written(tmp_path / "a.csv", text))


def test_stamps_are_exact_for_integers_and_for_the_last_digits_of_seconds():
    assert stamps_of(np.array([1_700_000_000_123_456_789]), 1)[0] == 1_700_000_000_123_456_789
    seconds = stamps_of(np.array([1_700_000_000.5, np.nan, 0.0001]), 1_000_000_000)
    assert list(seconds) == [1_700_000_000_500_000_000, NO_STAMP, 100_000]


def test_dates_are_read_as_stamps(tmp_path):
    text = "when,p,c\n2026-01-01T00:00:00.001Z,0,0\n2026-01-01T00:00:00.002Z,1,1\n"
    columns = read_columns(written(tmp_path / "a.csv", text))
    mapping = mapping_from({"position": "p", "command": "c", "clock": "when"})
    assert np.diff(table_series(columns, mapping).stamps_ns)[0] == 1_000_000
    assert columns.dates == ("when",)


def test_missing_times_are_rebuilt_from_neighbouring_rows(tmp_path):
    times = ["0", "1", "", "3", "", "", "6"]
    text = "t,p,c\n" + "".join(f"{t},{i},0\n" for i, t in enumerate(times))
    mapping = mapping_from(
        {"position": "p", "command": "c", "clock": {"source": "t", "unit": "ms"}}
    )
    series = table_series(read_columns(written(tmp_path / "a.csv", text)), mapping)
    assert np.array_equal(series.arrivals_ns, np.arange(7) * 1_000_000)
    assert np.count_nonzero(series.stamps_ns == NO_STAMP) == 3


def test_rows_without_a_time_get_times_from_the_rate(tmp_path):
    mapping = mapping_from({"position": "p", "command": "c", "clock": {"rate_hz": 400}})
    text = "p,c\n0,0\n1,1\n2,2\n"
    series = table_series(read_columns(written(tmp_path / "a.csv", text)), mapping)
    assert list(series.stamps_ns) == [0, 2_500_000, 5_000_000]


def test_parquet_gives_the_same_columns(tmp_path):
    frame = pd.DataFrame(VALUES, columns=["t", "pos", "cur"])
    frame["state"] = "on"
    frame["when"] = pd.to_datetime([1, 2, 3], unit="ms", utc=True)
    frame.to_parquet(tmp_path / "a.parquet")
    columns = read_columns(tmp_path / "a.parquet")
    assert np.array_equal(np.column_stack([columns.values[n] for n in ("t", "pos", "cur")]), VALUES)
    assert (list(columns.texts), columns.dates) == (["state"], ("when",))
    assert list(columns.values["when"]) == [1_000_000, 2_000_000, 3_000_000]
    (tmp_path / "b.parquet").write_text("no")
    with pytest.raises(ValueError, match=r"b\.parquet is not a Parquet file"):
        read_columns(tmp_path / "b.parquet")


def test_table_with_all_numbers_in_comments_is_refused(tmp_path):
    path = written(tmp_path / "a.csv", "# 1,2\n# 3,4\n# 5,6\n")
    with pytest.raises(ValueError, match=r"none of the first 3 lines is a row of numbers"):
        read_columns(path)


def test_column_may_be_a_difference_of_columns(tmp_path):
    path = tmp_path / "set_point.csv"
    path.write_text("t,set point,following-error\n0,1.0,0.25\n1,2.0,0.5\n2,3.0,0.5\n")
    columns = read_columns(path)
    assert list(columns.column("set point - following-error")) == [0.75, 1.5, 2.5]
    with pytest.raises(ValueError, match="'set point - error'"):
        columns.column("set point - error")


FLAP = described(1000)
RPM = 60.0 / (2.0 * np.pi)


@pytest.fixture
def guessed(telemetry, tmp_path):
    """Return a function that guesses from named columns; each is (column, factor)."""
    columns = {
        "t": telemetry.stamps_ns * 1e-9,
        "p": telemetry.position,
        "c": telemetry.command,
        "s": telemetry.speed,
        "i": telemetry.current,
        "e": telemetry.command - telemetry.position,
    }

    def guess(**named):
        frame = pd.DataFrame({name: columns[key] * factor for name, (key, factor) in named.items()})
        frame.to_csv(tmp_path / "a.csv", index=False)
        return open_input(tmp_path / "a.csv").guess(FLAP)

    return guess


def test_registers_of_a_servo_are_guessed_with_their_sign(telemetry, tmp_path):
    """The current has a sign bit; angles are in two's complement."""
    milliamperes = np.round(1e3 * telemetry.current)
    counts = np.round(telemetry.position * 1e6)
    frame = pd.DataFrame(
        {
            "timestamp": telemetry.stamps_ns,
            "goal_position": np.round(telemetry.command * 1e6) % 2.0**32,
            "present_position": counts % 2.0**32,
            "present_current_mA": np.where(milliamperes < 0.0, 2**15 - milliamperes, milliamperes),
        }
    )
    frame.astype(np.int64).to_csv(tmp_path / "servo.csv", index=False)
    mapping = open_input(tmp_path / "servo.csv").guess(FLAP).mapping
    assert mapping.current is not None
    assert (mapping.current.encoding, mapping.current.kind) == ("sign_bit_16", "equivalent")
    for source in (mapping.position, mapping.command):
        assert source is not None
        assert source.encoding == "twos_complement_32"
    # An encoder that is always above half of its range has no sign.
    frame["present_position"] = 40000 + counts % 1000
    frame.to_csv(tmp_path / "servo.csv", index=False)
    assert not open_input(tmp_path / "servo.csv").guess(FLAP).mapping.position.encoding


def as_mapping(sections, clock):
    return mapping_from({**sections, "clock": clock, "table": {"separator": ",", "decimal": "."}})


@pytest.mark.parametrize(
    ("columns", "sections", "clock"),
    [
        (  # Names and units are sufficient.
            {
                "time_ms": ("t", 1e3),
                "flap_pos_deg": ("p", 57.29577951),
                "cmd_deg": ("c", 57.29577951),
                "motor_speed_rpm": ("s", RPM),
                "iq [mA]": ("i", 1154.7),
            },
            {
                "position": {"source": "flap_pos_deg", "unit": "deg"},
                "command": {"source": "cmd_deg", "unit": "deg"},
                "speed": {"source": "motor_speed_rpm", "unit": "rpm"},
                "current": {"source": "iq [mA]", "unit": "mA", "kind": "i_q"},
            },
            {"source": "time_ms", "unit": "ms"},
        ),
        (  # Only names are available: units and signs follow from how the columns relate.
            {
                "t": ("t", 1e6),
                "position": ("p", 57.29577951),
                "setpoint": ("c", 57.29577951),
                "velocity": ("s", -FLAP.parameters.tau),
                "current": ("i", -1.0),
            },
            {
                "position": {"source": "position", "unit": "deg"},
                "command": {"source": "setpoint", "unit": "deg"},
                "speed": {"source": "velocity", "shaft": "user", "sign": -1},
                "current": {"source": "current", "sign": -1},
            },
            {"source": "t", "unit": "us"},
        ),
        (  # From a slow logger: a position error instead of the command, and no other columns.
            {"Zeit [s]": ("t", 1.0), "Winkel": ("p", 1.0), "following_error": ("e", 1.0)},
            {"position": {"source": "Winkel"}, "error": {"source": "following_error"}},
            {"source": "Zeit [s]"},
        ),
        (  # torque at the motor
            {
                "timestamp": ("t", 1e9),
                "actual_position": ("p", 1.0),
                "target_position": ("c", 1.0),
                "torque_actual": ("i", FLAP.parameters.k_t),
            },
            {
                "position": {"source": "actual_position"},
                "command": {"source": "target_position"},
                "current": {"source": "torque_actual", "unit": "N.m", "kind": "motor_torque"},
            },
            {"source": "timestamp", "unit": "ns"},
        ),
    ],
    ids=["units", "relations", "error", "torque"],
)
def test_mapping_is_guessed(guessed, columns, sections, clock):
    assert guessed(**columns).mapping == as_mapping(sections, clock)


@pytest.mark.parametrize("name", ["current_mA", "i_mA", "Current mA", "current_A", "Current [A]"])
def test_unit_in_the_name_of_a_current_is_recognised(guessed, name):
    factor = 1000.0 if "mA" in name else 1.0
    guess = guessed(**{"t": ("t", 1), "pos": ("p", 1), "cmd": ("c", 1), name: ("i", factor)})
    assert guess.mapping.current.unit == ("mA" if "mA" in name else "A")


def test_torque_at_the_joint_is_recognised_by_its_size(guessed):
    p = FLAP.parameters
    guess = guessed(t=("t", 1.0), pos=("p", 1.0), cmd=("c", 1.0), torque=("i", p.k_t / p.tau))
    assert guess.mapping.current is not None
    assert guess.mapping.current.kind == "joint_torque"


def test_guesses_are_reported(guessed):
    remarks = remarks_of(guessed(t=("t", 1.0), pos=("p", 1.0), cmd=("c", 1.0), cur=("i", 1.0)))
    words = "\n".join(remarks)
    assert "current.unit is a guess" in words
    assert "current.sampling cannot be inferred" in words
    assert "no column was recognized as speed" in words


def test_effort_that_never_changes_counts_as_not_measured(guessed):
    guess = guessed(t=("t", 1.0), pos=("p", 1.0), cmd=("c", 1.0), effort=("i", 0.0))
    assert guess.mapping.current is None
    assert any("current never changes" in item for item in remarks_of(guess))


def test_table_without_a_command_is_refused_with_its_columns(guessed):
    with pytest.raises(ValueError, match=r"no column was recognized as command.*columns: t, pos"):
        guessed(t=("t", 1.0), pos=("p", 1.0))


def test_columns_of_two_joints_are_not_mixed(guessed):
    guess = guessed(
        t=("t", 1.0),
        right_command=("c", 0.5),
        left_pos=("p", 1.0),
        left_command=("c", 1.0),
        right_pos=("p", 0.5),
    )
    mapping = guess.mapping
    assert (mapping.position.source, mapping.command.source) == ("{joint}_pos", "{joint}_command")
    assert [text for _, text, _ in mapping.wanted()] == ["right_pos", "right_command"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: 0.0 * t, "never changes and is not a clock"),
        (lambda t: t.sample(frac=1.0, random_state=1).to_numpy(), "decreases"),
    ],
)
def test_unreadable_time_column_is_refused_unless_a_rate_is_given(
    telemetry, tmp_path, change, words
):
    frame = pd.DataFrame(
        {
            "time [s]": change(pd.Series(telemetry.stamps_ns * 1e-9)),
            "position": telemetry.position,
            "command": telemetry.command,
        }
    )
    frame.to_csv(tmp_path / "a.csv", index=False)
    source = open_input(tmp_path / "a.csv")
    with pytest.raises(ValueError, match=rf"column 'time \[s\]' .*{words}.* clock\.rate_hz"):
        source.guess(FLAP)
    assert source.guess(FLAP, Clock(rate_hz=500)).mapping.clock.rate_hz == 500


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("in_heading", [False, True])
def test_separator_at_the_end_of_each_line_keeps_the_names(tmp_path, separator, in_heading):
    lines = [f"{row}{separator}" for row in rows(separator).splitlines()]
    head = separator.join(["t", "pos", "cur"]) + separator * in_heading
    columns = read_columns(written(tmp_path / "a.csv", "\n".join([head, *lines, ""])))
    assert list(columns.values) == ["t", "pos", "cur"]
    assert np.array_equal(np.column_stack(list(columns.values.values())), VALUES)


def frame_of(telemetry, start="2026-10-20T08:00"):
    stamps = pd.Timestamp(start, tz="UTC") + pd.to_timedelta(telemetry.stamps_ns, unit="ns")
    columns = {"command": telemetry.command, "position": telemetry.position}
    columns |= {"speed": telemetry.speed, "current": telemetry.current}
    return stamps, pd.DataFrame(columns)


def test_index_of_a_parquet_frame_is_its_time(telemetry, tmp_path):
    stamps, frame = frame_of(telemetry)
    frame = frame.set_index(stamps).drop(index=stamps[700:709])
    path = tmp_path / "a.parquet"
    frame.to_parquet(path)
    source = open_input(path)
    mapping = source.guess(described(1000)).mapping
    assert mapping.clock.source == "time"
    series = source.series(mapping)[""]
    start_ns = pd.Timestamp("2026-10-20T08:00", tz="UTC").value
    expected = np.delete(start_ns + telemetry.stamps_ns, slice(700, 709))
    assert np.array_equal(series.stamps_ns, expected)


def test_time_since_the_start_is_read_in_seconds(telemetry, tmp_path):
    _, frame = frame_of(telemetry)
    index = pd.to_timedelta(telemetry.stamps_ns, unit="ns")
    frame.set_index(pd.TimedeltaIndex(index, name="elapsed")).to_parquet(tmp_path / "a.parquet")
    columns = read_columns(tmp_path / "a.parquet")
    assert columns.units["elapsed"] == "s"
    np.testing.assert_allclose(columns.values["elapsed"], 1e-9 * telemetry.stamps_ns, rtol=1e-12)


def test_two_levels_of_headings_form_one_name(tmp_path):
    first = pd.DataFrame(
        [[0.0, 1.0, 2.0]] * 3,
        columns=pd.MultiIndex.from_tuples([("drive", "t [ms]"), ("drive", "a"), ("drive", "b")]),
    )
    first.to_parquet(tmp_path / "one.parquet")
    assert list(read_columns(tmp_path / "one.parquet").values) == ["t [ms]", "a", "b"]
    second = first.set_axis(
        pd.MultiIndex.from_tuples([("", "t"), ("left", "pos"), ("right", "pos")]), axis=1
    )
    second.to_parquet(tmp_path / "two.parquet")
    names = list(read_columns(tmp_path / "two.parquet").values)
    assert names == ["t", "left pos", "right pos"]


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_rows_from_newest_to_oldest_are_reversed(telemetry, tmp_path, kind):
    stamps, frame = frame_of(telemetry)
    frame.insert(0, "Time", stamps.strftime("%Y-%m-%dT%H:%M:%S.%f"))
    path = tmp_path / f"a.{kind}"
    newest_first = frame.iloc[::-1]
    if kind == "csv":
        newest_first.to_csv(path, index=False)
    else:
        newest_first.to_parquet(path, index=False)
    source = open_input(path)
    guess = source.guess(described(1000))
    assert guess.mapping.clock.source == "Time"
    assert guess.mapping.speed is not None
    assert guess.mapping.speed.sign == 1
    series = source.series(guess.mapping)[""]
    assert np.all(np.diff(series.stamps_ns) == 1_000_000)
    np.testing.assert_allclose(series.values["position"], telemetry.position, atol=1e-15)
    assert source.remarks == ["'Time' decreases from row to row: the rows are read in reverse"]


def test_table_without_a_command_is_guessed_for_an_unknown_drive(telemetry, tmp_path):
    _, frame = frame_of(telemetry)
    frame.insert(0, "t", 1e-9 * telemetry.stamps_ns)
    path = tmp_path / "a.csv"
    frame.drop(columns="command").to_csv(path, index=False)
    source = open_input(path)
    guess = source.guess(replace(described(1000), drive="unknown"))
    assert not guess.mapping.has_command
    assert "no command was recognized: tracking is not assessed" in remarks_of(guess)
    with pytest.raises(ValueError, match=r"with drive: unknown in the actuator file, no command"):
        source.guess(described(1000))


PLAIN = "t,n,x\n0.1,3,1e-3\n0.2,4,-0.25\n0.3,5,nan\n"


@pytest.mark.parametrize(
    ("text", "is_plain"),
    [
        (PLAIN, True),
        (PLAIN.replace(",", ";"), True),
        (PLAIN.replace(",", " "), True),
        (PLAIN + "0.4,6.0,2\n", True),
        (PLAIN + 500 * "0.4,6,2\n", True),
        (PLAIN + 500 * "0.4,6,2\n" + "0.4,6.0,2\n", False),
        (PLAIN + 500 * "0.4,6,2\n" + "0.4,12345678901234567890,2\n", False),
        (PLAIN + "0.4,,2\n", False),
        (PLAIN + "0.4,6,up\n", False),
        (PLAIN + "\n0.4,6,2\n", True),
        (PLAIN + '"0.4",6,2\n', False),
        (PLAIN.replace("4,", "12345678901234567890,"), False),
        (PLAIN.replace("\n", ",\n"), False),
        ("# made by hand\n" + PLAIN, True),
        ("t,x\n1642118400.0,0.1\n1642118400.01,0.2\n", True),
    ],
)
def test_table_without_pandas_equals_the_table_read_by_pandas(
    tmp_path, monkeypatch, text, is_plain
):
    path, plain = written(tmp_path / "a.csv", text), []
    read = csv_file.read_plain_csv
    monkeypatch.setattr(
        csv_file, "read_plain_csv", lambda *a, **b: plain.append(read(*a, **b)) or plain[-1]
    )
    fast = read_columns(path)
    assert (plain[-1] is not None) == is_plain
    monkeypatch.setattr(csv_file, "read_plain_csv", lambda *_, **__: None)
    slow = read_columns(path)
    assert (fast.units, fast.dates, fast.texts.keys()) == (
        slow.units,
        slow.dates,
        slow.texts.keys(),
    )
    assert fast.values.keys() == slow.values.keys()
    for name, values in fast.values.items():
        assert values.dtype == slow.values[name].dtype
        np.testing.assert_array_equal(values, slow.values[name])


def test_every_digit_of_a_plain_table_is_read_as_by_pandas(tmp_path):
    rng = np.random.default_rng(1)
    frame = pd.DataFrame(
        {
            "t": 1.7e9 + np.cumsum(rng.uniform(0.0, 1e-3, 2000)),
            "x": rng.standard_normal(2000) * 10.0 ** rng.integers(-20, 20, 2000),
            "n": rng.integers(-(2**53), 2**53, 2000),
        }
    )
    frame.to_csv(path := tmp_path / "a.csv", index=False)
    columns = read_columns(path)
    for name in ("t", "x", "n"):
        np.testing.assert_array_equal(columns.values[name], frame[name].to_numpy())
        assert columns.values[name].dtype == frame[name].dtype


@pytest.mark.parametrize("missing", [False, True])
@pytest.mark.parametrize("index", [None, "step"])
def test_parquet_without_pandas_equals_parquet_read_by_pandas(
    tmp_path, monkeypatch, missing, index
):
    frame = pd.DataFrame(
        {"t": [0.1, 0.2, 0.3], "n": [1, 2, 3], "f": np.array([1.5, 2.5, 3.1], dtype=np.float32)}
    )
    if missing:
        frame["n"] = pd.array([1, None, 3], dtype="Int64")
    if index:
        frame.index = pd.RangeIndex(5, 8, name=index)
    frame.to_parquet(path := tmp_path / "a.parquet")
    fast = read_columns(path)
    monkeypatch.setattr(parquet_file, "plain_parquet", lambda _: None)
    slow = read_columns(path)
    assert list(fast.values) == list(slow.values)
    for name, values in fast.values.items():
        assert values.dtype == slow.values[name].dtype
        np.testing.assert_array_equal(values, slow.values[name])


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize(("in_heading", "in_rows"), [(0, 3), (2, 2), (3, 0), (1, 4), (4, 1)])
def test_separators_at_the_end_of_lines_make_no_columns(tmp_path, separator, in_heading, in_rows):
    lines = [f"{row}{in_rows * separator}" for row in rows(separator).splitlines()]
    head = separator.join(["t", "pos", "cur"]) + in_heading * separator
    columns = read_columns(written(tmp_path / "a.csv", "\n".join([head, *lines, ""])))
    assert list(columns.values) == ["t", "pos", "cur"]
    assert np.array_equal(np.column_stack(list(columns.values.values())), VALUES)


def test_lines_above_the_heading_are_not_data(tmp_path):
    about = "Logger;Version 3.1\nSerial;4711\nOperator;Ada;;\n\n"
    text = about + "t;pos;cur\n" + rows(";")
    columns = read_columns(written(tmp_path / "a.csv", text))
    assert list(columns.values) == ["t", "pos", "cur"]
    assert np.array_equal(np.column_stack(list(columns.values.values())), VALUES)


def test_column_that_is_empty_at_first_keeps_its_name(tmp_path):
    late = [f"{0.01 * i},{i}," + ("7" if i > 450 else "") for i in range(500)]
    columns = read_columns(written(tmp_path / "a.csv", "\n".join(["t,pos,temp", *late, ""])))
    assert list(columns.values) == ["t", "pos", "temp"]
    assert np.count_nonzero(np.isfinite(columns.values["temp"])) == 49


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_tables_in_utf_16_are_read(tmp_path, encoding):
    text = "t,pos,cur\n" + rows(",")
    mark = "" if encoding == "utf-16" else "\ufeff"
    (tmp_path / "a.csv").write_bytes((mark + text).encode(encoding))
    columns = read_columns(tmp_path / "a.csv")
    assert np.array_equal(np.column_stack(list(columns.values.values())), VALUES)


def test_surplus_cell_is_named_with_its_line(tmp_path):
    lines = ["t,pos,cur", *["1,2,3"] * 500, "1,2,3,4", *["1,2,3"] * 10, ""]
    path = written(tmp_path / "a.csv", "\n".join(lines))
    with pytest.raises(ValueError, match=r"line 502 has 4 cells, expected 3 .* or quote the cell"):
        read_columns(path)


def test_table_without_numbers_shows_the_expected_format(tmp_path):
    text = "t,pos\n" + "".join(f"{i}%,{i}%\n" for i in range(20))
    with pytest.raises(ValueError, match=r"cells such as\s+1.5, .* found '19%,19%'|is not a table"):
        read_columns(written(tmp_path / "a.csv", text))


def test_exponents_of_fortran_are_read(tmp_path):
    text = "t,pos\n" + "".join(f"{i},1.{i}D+01\n" for i in range(9))
    columns = read_columns(written(tmp_path / "a.csv", text))
    assert columns.values["pos"] == pytest.approx([10.0 + i for i in range(9)])
