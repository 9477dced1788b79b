# SPDX-License-Identifier: Apache-2.0
"""``ema compare``: several algorithms on one window."""

import json
import signal

import numpy as np
import pytest

from ema_bags.actuator_bag import SimulatedActuatorBag
from ema_bags.writer import BagWriter
from ema_cli import comparison
from ema_cli.bags.identifying import Identifying
from ema_cli.bags.reading import ReadingOptions, read_windows
from ema_cli.comparison import AlgorithmComparison, choose_window, compare_algorithms
from ema_core.description import ActuatorDescription
from ema_core.faults import FAULT_NAMES, estimation_error, fault_vector
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.diagnosis import Identification
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.optimizers import ALGORITHMS

from .conftest import repeated

OPTIONS = ReadingOptions()
QUICK = ("--algorithms", "least_squares,pso", "-p", "budget=400")
DRAWN = {"friction": 0.2, "eccentricity": 0.1, "eccentricity_phase": 0.7, "gain": 0.6}


def first_row(printed: str, name: str) -> list[str]:
    return next(line.split() for line in printed.splitlines() if line.startswith(f"{name} "))


@pytest.fixture(scope="module")
def bag(ema, tmp_path_factory):
    """Return a bag with two cycles with faults."""
    path = tmp_path_factory.mktemp("compare") / "case.mcap"
    # A fault may be given by its label.
    labels = [name.replace("_", " ").capitalize() for name in DRAWN]
    faults = ",".join(f"{name}={value}" for name, value in zip(labels, DRAWN.values(), strict=True))
    assert ema("simulate", "--fault", faults, "--cycles", "2", "-o", path).exit_code == 0
    return path


@pytest.fixture(scope="module")
def compared(ema, bag):
    """Return the comparison of all algorithms on the second window."""
    result = ema("compare", bag, "--window", "1", "-p", "budget=400", "--json")
    assert result.exit_code in (0, 3)
    return json.loads(result.stdout)


@pytest.fixture(scope="module")
def shown(ema, bag) -> str:
    """Return the printed comparison of the first window."""
    return ema("compare", bag, *QUICK).stdout


@pytest.fixture(scope="module")
def quick(bag) -> AlgorithmComparison:
    recording = read_windows(bag, OPTIONS)
    options = Identifying(search=SearchSettings(budget=400))
    calibration = Calibration.builtin()
    truth = recording.true_faults(recording.windows[0].start_ns)
    return compare_algorithms(
        recording.windows[0], ["least_squares", "pso"], calibration, options, truth
    )


@pytest.mark.long
def test_every_registered_algorithm_has_one_entry(compared):
    estimates = compared["estimates"]
    assert [estimate["algorithm"] for estimate in estimates] == list(ALGORITHMS)
    for estimate in estimates:
        assert list(estimate["faults"]) == list(FAULT_NAMES)
        assert 0 < estimate["generations"] < estimate["evaluations"] <= 400
        assert estimate["fitness"] > 0.0
        assert estimate["search_fitness"] > 0.0
        assert estimate["computing_time"] > 0.0
        assert not estimate["warm_start"]


@pytest.mark.long
def test_errors_are_relative_to_the_recorded_truth(compared):
    assert compared["truth"] == dict(zip(FAULT_NAMES, fault_vector(DRAWN), strict=True))
    for estimate in compared["estimates"]:
        expected = estimation_error(list(estimate["faults"].values()), fault_vector(DRAWN))
        assert estimate["error_percent"] == pytest.approx(expected, rel=1e-12)
    # Measured: 0.6 %.
    assert compared["estimates"][0]["error_percent"] < 1.5


@pytest.mark.long
@pytest.mark.parametrize("algorithm", ["least_squares", "pso"])
def test_each_algorithm_gives_the_same_result_as_alone_from_the_healthy_point(
    ema, bag, compared, algorithm
):
    arguments = ("--algorithm", algorithm, "-p", "budget=400", "-p", "warm_start=false", "--json")
    alone = json.loads(ema("estimate", bag, *arguments).stdout)[1]
    [beside] = [
        estimate for estimate in compared["estimates"] if estimate["algorithm"] == algorithm
    ]
    del alone["computing_time"]
    assert {name: beside[name] for name in alone} == alone


def test_cost_at_the_truth_equals_the_cost_of_a_true_estimate(ema, tmp_path):
    path = tmp_path / "healthy.mcap"
    ema("simulate", "-o", path)
    result = ema("compare", path, "--algorithms", "least_squares", "--json")
    answer = json.loads(result.stdout)
    [estimate] = answer["estimates"]
    # No fault is significant, so the estimate is exactly the healthy vector.
    assert list(estimate["faults"].values()) == list(fault_vector({}))
    assert answer["fitness_at_truth"] == pytest.approx(estimate["fitness"], rel=1e-9)
    assert estimate["error_percent"] == 0.0


def test_truth_of_a_window_comes_from_its_own_cycle(ema, tmp_path, faulty_blocks):
    path = tmp_path / "growing.mcap"
    blocks = repeated(faulty_blocks, 2)
    with SimulatedActuatorBag(BagWriter(path), ActuatorDescription()) as recording:
        for cycle, friction in enumerate((0.3, 0.4)):
            recording.begin_cycle(cycle, fault_vector({"friction": friction}), 10.0 * cycle)
            for block in blocks[cycle * len(faulty_blocks) :][: len(faulty_blocks)]:
                recording.write_block(block, 0.0)
    errors = []
    for number, friction in enumerate((0.3, 0.4)):
        result = ema("compare", path, "--window", number, "--algorithms", "least_squares", "--json")
        answer = json.loads(result.stdout)
        assert answer["window"] == number
        assert answer["truth"]["friction"] == friction
        errors.append(answer["estimates"][0]["error_percent"])
    # Both cycles have 0.3 in the telemetry; only the recorded truth differs, by 10 %.
    assert errors[0] < 2.0
    assert errors[1] == pytest.approx(10.0, abs=2.0)


def test_tables_show_all_numbers(shown):
    assert len(first_row(shown, "least_squares")) == 9
    assert first_row(shown, "truth")[1:] == [f"{k:.4f}" for k in fault_vector(DRAWN)]
    assert "sigma of least_squares" in shown
    assert "fitness at the true faults" in shown
    # A terminal of 80 columns does not wrap the table.
    assert max(map(len, shown.split("pso: ")[0].splitlines()[1:])) <= 80
    assert "…" not in shown


def test_bag_without_truth_has_no_errors(ema, record, faulty_blocks):
    path = record(faulty_blocks)
    answer = json.loads(ema("compare", path, *QUICK, "--json").stdout)
    assert answer["truth"] is None
    assert answer["fitness_at_truth"] is None
    assert [estimate["error_percent"] for estimate in answer["estimates"]] == [None, None]
    table = ema("compare", path, *QUICK).stdout
    assert "\ntruth " not in table
    assert "at the true faults" not in table
    assert "error" not in table


def test_cost_curve_ends_at_the_final_cost(quick):
    for run in quick.runs:
        assert np.all(np.diff(run.costs) <= 0.0)
        assert np.all(np.diff(run.evaluations) > 0)
        assert run.evaluations[-1] <= run.estimate.evaluations
        assert run.search_fitness == min(run.costs)


def test_first_usable_window_is_chosen(ema, bag, tmp_path, record, faulty_blocks, spoiled):
    recording = read_windows(bag, OPTIONS)
    assert choose_window(recording, None).number == 0
    blocks = repeated(faulty_blocks, 2)
    blocks[100] = spoiled(blocks[100], "current", 7, np.nan)
    path = record(blocks)
    assert json.loads(ema("compare", path, *QUICK, "--json").stdout)["window"] == 1
    refused = ema("compare", path, *QUICK, "--window", "0")
    assert refused.exit_code == 3
    assert "least_squares, pso: no valid estimate: current is nan" in refused.stdout


def test_interrupt_ends_the_command_with_one_line(ema, bag, tmp_path, monkeypatch):
    class Interrupted(Identification):
        def __iter__(self):
            for generation in super().__iter__():
                signal.raise_signal(signal.SIGINT)
                yield generation

    monkeypatch.setattr(comparison, "Identification", Interrupted)
    result = ema("compare", bag, *QUICK)
    assert (result.exit_code, result.stderr.strip()) == (1, "Aborted!")
