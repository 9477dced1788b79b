"""What departs from the healthy windows of a calibration, from tables to a verdict."""

import json

import numpy as np
import pandas as pd
import pytest

from ema_monitor.normal.features import part_of
from ema_monitor.prognosis.history import History, history_path
from ema_monitor.prognosis.history_entry import UnusedCycle

from .test_import_guide import REAL
from .test_slow_records import MAPPING, written

SLIDE = "actuator_id: slide\nserial_number: {}\nsample_period: 0.04\ndrive: unknown\n"


@pytest.fixture(scope="module")
def bags(ema, tmp_path_factory):
    """Import slides with given friction; return the bag."""
    folder = tmp_path_factory.mktemp("slides")
    (folder / "mapping.yaml").write_text(MAPPING)

    def imported(name, *, serial="R1", **changes):
        bag = folder / f"{name}.mcap"
        if not bag.exists():
            (folder / f"{serial}.yaml").write_text(SLIDE.format(serial) + "parameters: {tau: 1}\n")
            table = written(folder / f"{name}.csv", 25, 60.0, **changes)
            result = ema(
                *("import", table, "--mapping", folder / "mapping.yaml"),
                *("--actuator", folder / f"{serial}.yaml", "-o", bag),
            )
            assert result.exit_code == 0, result.output
        return bag

    return imported


@pytest.fixture(scope="module")
def healthy(bags):
    return [bags(f"healthy{seed}", friction_a=0.6 + 0.002 * seed, seed=seed) for seed in range(5)]


def test_estimate_departs_where_no_fault_explains_what_changed(ema, tmp_path, bags, healthy):
    calibration = tmp_path / "calibration.yaml"
    window = ("--any-motion", "-p", "window_s=6")
    assert ema("calibrate", *healthy, *window, "-o", calibration).exit_code == 0
    command = (*window, "--calibration", calibration)
    result = ema("estimate", bags("again", friction_a=0.603, seed=11), *command)
    assert result.exit_code == 0, result.output
    rough = bags("rough", friction_a=0.6, seed=13, current_noise=0.03)
    result = ema("estimate", rough, *command)
    told = " ".join(result.output.split())
    assert result.exit_code == 3, told
    assert "found:" not in told
    assert "departed, goodness of fit" in told
    assert "the roughness of the current in the" in told
    assert "no fault explains it" in told
    result = ema("estimate", rough, *command, "--json")
    assert [one["verdict"] for one in json.loads(result.stdout)] == ["departed"]
    for again in (("prognose", "--hours-per-cycle", "1"), ("report", "-o", tmp_path / "unit.html")):
        result = ema(again[0], rough, *command, *again[1:])
        told = " ".join(result.output.split())
        assert result.exit_code == 3, told
        assert "WARN" in told or "Changed: departed" in told
    result = ema("estimate", bags("dry", friction_a=0.75, seed=12), *command)
    assert result.exit_code == 0, result.output
    assert "departed" not in result.output


def told(ema, bag, calibration, *options):
    result = ema("estimate", bag, "--any-motion", "--calibration", calibration, "--json", *options)
    return json.loads(result.stdout)[0]


def test_loads_of_the_healthy_windows_are_told_apart(ema, tmp_path, bags, healthy):
    window = ("-p", "window_s=6")
    loaded = [bags(f"loaded{seed}", load_a=0.3, seed=40 + seed) for seed in range(3)]
    later = bags("later", load_a=0.3, seed=50)
    rough = bags("loaded_rough", load_a=0.3, seed=51, current_noise=0.03)
    verdicts = []
    for known in (healthy, [*healthy, *loaded]):
        calibration = tmp_path / f"{len(known)}.yaml"
        result = ema("calibrate", *known, "--any-motion", *window, "-o", calibration)
        assert result.exit_code == 0, result.output
        verdicts += [told(ema, bag, calibration, *window)["verdict"] for bag in (later, rough)]
    # A new load may be what makes the current rough; one that is known does not.
    assert verdicts == ["valid", "valid", "valid", "departed"]


def test_load_that_is_new_hides_friction_at_one_speed(ema, tmp_path):
    given = ("--mapping", REAL / "mapping.yaml", "--actuator", REAL / "actuator.yaml")
    for name in ("healthy_1", "healthy_2", "healthy_3", "healthy_4", "dry"):
        result = ema("import", REAL / f"{name}.csv", *given, "-o", tmp_path / f"{name}.mcap")
        assert result.exit_code == 0, result.output
    pushed = pd.read_csv(REAL / "healthy_5.csv")
    pushed["current_a"] += 0.3 * np.sign(np.gradient(pushed["set_point_mm"]))
    pushed.to_csv(tmp_path / "pushed.csv", index=False)
    assert (
        ema("import", tmp_path / "pushed.csv", *given, "-o", tmp_path / "pushed.mcap").exit_code
        == 0
    )
    calibration = tmp_path / "slide.yaml"
    known = [tmp_path / f"healthy_{number}.mcap" for number in range(1, 5)]
    assert ema("calibrate", *known, "--any-motion", "-o", calibration).exit_code == 0
    found = told(ema, tmp_path / "pushed.mcap", calibration)
    assert "friction" in found["unobservable"]
    assert "A outside the loads of the healthy windows, and friction may" in found["reason"]
    assert "outside" not in told(ema, tmp_path / "dry.mcap", calibration)["reason"]


def test_state_that_was_labelled_is_named_by_estimate_and_report(ema, tmp_path, bags, healthy):
    calibration = tmp_path / "calibration.yaml"
    window = ("--any-motion", "-p", "window_s=6")
    assert ema("calibrate", *healthy, *window, "-o", calibration).exit_code == 0
    # Friction explains the first one, not the second.
    dry, rough = {"friction_a": 0.75}, {"current_noise": 0.03}
    for state, change, seed in (("dry", dry, 60), ("worn screw", rough, 70)):
        some = [bags(f"{state}{n}", seed=seed + n, **change) for n in range(3)]
        result = ema("label", calibration, *some, "--state", state, *window)
        assert result.exit_code == 0, result.output
        assert f"3 tests {state}" in result.output
    command = (*window, "--calibration", calibration)
    result = ema("estimate", bags("dry later", seed=90, **dry), *command)
    assert result.exit_code == 0, result.output
    assert "looks like: dry " in " ".join(result.output.split())
    later = bags("rough later", seed=90, **rough)
    result = ema("estimate", later, *command)
    assert result.exit_code == 3, result.output
    assert "looks like: worn screw " in " ".join(result.output.split())
    page = tmp_path / "unit.html"
    assert ema("report", later, *command, "-o", page).exit_code == 3
    assert "looks like: worn screw " in page.read_text()
    for wrong, state, words in (
        (bags("other", serial="R2"), "dry", "was made on 'R1': `ema calibrate` makes its own"),
        (later, "healthy", "`ema calibrate` takes all healthy bags together"),
    ):
        result = ema("label", calibration, wrong, "--state", state, *window)
        assert result.exit_code == 1
        assert words in " ".join(result.stderr.split())
    result = ema("calibrate", *healthy, *window, "--replace", "-o", calibration)
    assert "labelled states kept: dry, worn screw" in result.stdout
    # A history has the figures of its tests without the bags.
    [found] = json.loads(ema("estimate", later, *command, "--json").stdout)
    path = history_path(tmp_path, "slide", "R1")
    history, parts = History("slide", "R1", path), tuple(map(part_of, found["parts"]))
    history.append(UnusedCycle(86_400 * 10**9, "departed", "", parts=parts))
    history.close()
    for test, words in (
        ("1", "3 tests dry, 4 tests worn screw"),
        ("1970-01-02", "3 tests dry, 4 tests worn screw"),
        ("2", "expected number or date of a test; its last, 1, is of 1970-01-02T00:00:00"),
    ):
        result = ema("label", calibration, path, "--test", test, "--state", "worn screw")
        assert words in result.output
    assert ema("label", calibration, later, "--test", "1", "--state", "dry").exit_code == 2
    result = ema("label", calibration, "--remove", "dry")
    assert "10 tests healthy, 4 tests worn screw" in result.stdout


def test_table_with_a_mapping_beside_it_is_read_as_a_bag_and_labels_by_its_columns(
    ema, tmp_path, bags, healthy
):
    calibration = tmp_path / "calibration.yaml"
    tables = [bag.with_suffix(".csv") for bag in healthy]
    window = ("--any-motion", "-p", "window_s=6", "--actuator", tables[0].with_name("R1.yaml"))
    assert ema("calibrate", *tables, *window, "-o", calibration).exit_code == 0
    frames = []
    for state, change in (("normal", {}), ("rough", {"current_noise": 0.03})):
        for number in range(3):
            made = bags(f"{state}{number}", seed=110 + number, **change).with_suffix(".csv")
            frames.append(pd.read_csv(made).assign(condition=state, trial=number))
    pd.concat(frames).to_csv(tmp_path / "all.csv", index=False)
    columns = ("--state-column", "condition", "--test-column", "trial")
    command = ("label", calibration, tmp_path / "all.csv", *window, *columns)
    result = ema(*command)
    assert "all.csv is a table without a mapping beside it" in result.stderr
    (tmp_path / "mapping.yaml").write_text(MAPPING)
    result = ema(*command)
    assert "10 tests healthy, 3 tests rough" in result.stdout, result.output
    assert ema("label", calibration).stdout == result.stdout
    later = bags("rough later", seed=90, current_noise=0.03).with_suffix(".csv")
    result = ema("estimate", later, *window, "--calibration", calibration)
    assert "looks like: rough" in " ".join(result.output.split())


def test_table_of_moves_is_followed_to_its_limit(ema, tmp_path):
    rng = np.random.default_rng(0)
    days = pd.date_range("2026-01-01", periods=14)
    ratio = np.where(np.arange(14) < 6, 1.0, 1.0 + 0.08 * (np.arange(14) - 5))
    rows = [
        {"day": f"{day:%Y-%m-%d}", "serial": "A7", "hz": hz, "rms": hz * one * rng.normal(1, 0.01)}
        for day, one in zip(days, ratio, strict=True)
        for hz in (1.0, 2.0)
    ]
    pd.DataFrame(rows).to_csv(tmp_path / "moves.csv", index=False)
    mapping = tmp_path / "moves.yaml"
    mapping.write_text("time: day\nfigures: [rms]\nlike: [hz]\nunit: serial\n")
    command = ("moves", tmp_path / "moves.csv", "--mapping", mapping, "--limit", "1.5")
    result = ema(*command, "--json")
    assert result.exit_code == 3, result.output
    told = json.loads(result.stdout)
    assert [one["level"] for one in told] == [
        *["STALE"] * 5,
        *["OK"] * 2,
        *["WARN"] * 5,
        *["ERROR"] * 2,
    ]
    assert {one["unit"] for one in told} == {"A7"}
    low, _, high = told[9]["life_days"]
    assert low <= 2.25 <= high
    mapping.write_text("time: day\nfigures: [rmss]\n")
    result = ema(*command)
    assert result.exit_code == 1
    assert "rmss" in result.stderr


def test_calibration_of_another_unit_is_the_whole_reason(ema, tmp_path):
    healthy, case, calibration = (tmp_path / name for name in ("h.mcap", "c.mcap", "c.yaml"))
    ema("simulate", "--cycles", "6", "-p", "serial_number=S2", "-o", healthy)
    ema("simulate", "--fault", "friction=0.2", "--start", "2026-01-01", "-o", case)
    assert ema("calibrate", healthy, "-o", calibration).exit_code == 0
    result = ema("estimate", case, "--calibration", calibration, "--json")
    assert result.exit_code == 3
    reason = json.loads(result.stdout)[0]["reason"]
    assert reason.startswith("the calibration does not fit: the actuator has serial number")
