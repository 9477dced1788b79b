# SPDX-License-Identifier: Apache-2.0
"""``ema learn-fleet`` learns growth from histories; monitors and prognoses use it."""

from pathlib import Path

import pytest

from ema_monitor.prognosis.fleet_growth import FleetGrowth
from ema_monitor.prognosis.history import History, history_path
from ema_monitor.prognosis.history_entry import Entry

from ..commands import SAMPLE
from ..prognosis.made_tests import made_test
from ..ros.monitor_session import FLAP, monitor

TESTS = 40


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with histories of three units; friction grows in two of them."""
    folder = tmp_path_factory.mktemp("site")
    for serial, growth in (("1", 0.005), ("2", 0.006), ("3", 0.0)):
        history = History("flap", serial, history_path(folder, "flap", serial))
        for number in range(TESTS):
            estimate = made_test(number, seed=int(serial), friction=0.1 + growth * number)
            history.append(Entry(estimate, 10.0 * number, number + 1))
        history.close()
    return folder


@pytest.fixture(scope="module")
def fleet(ema, site: Path) -> Path:
    path = site / "fleet.npz"
    result = ema("learn-fleet", site, "-o", path, "--name", "line A")
    assert result.exit_code == 0, result.output
    assert f"{path}: 3 units, 2 with a growing fault" in result.stdout
    assert "friction" in result.stdout
    return path


def test_sites_combine_their_growth_without_sharing_tests(ema, site, fleet, tmp_path):
    single = tmp_path / "one.npz"
    assert ema("learn-fleet", history_path(site, "flap", "1"), "-o", single).exit_code == 0
    both, together = tmp_path / "both.npz", ("learn-fleet", single, history_path(site, "flap", "2"))
    assert ema(*together, "-o", both).exit_code == 0
    units_of = [set(FleetGrowth.read(file).units) for file in (single, both, fleet)]
    assert [len(units) for units in units_of] == [1, 2, 3]
    assert units_of[0] < units_of[1] < units_of[2]
    result = ema(*together, "-o", both)
    assert (result.exit_code, "already exists" in result.stderr) == (1, True)
    assert ema(*together, single, "-o", both, "--replace").exit_code == 0


def test_file_that_is_not_a_history_is_named(ema, fleet, tmp_path: Path):
    for source, output, reason in (
        (tmp_path, "a.npz", "has no file ACTUATOR+SERIAL.sqlite: expected a history_folder"),
        (fleet, "a.json", "expected a name that ends in .npz"),
        (__file__, "a.npz", "expected a file name of the form ACTUATOR+SERIAL"),
    ):
        result = ema("learn-fleet", source, "-o", tmp_path / output)
        assert (result.exit_code > 0, reason in result.stderr) == (True, True), result.stderr
        assert not (tmp_path / output).exists()
    result = ema("learn-fleet", fleet, "-o", tmp_path / "a.npz", "--limit", "friction=0.3")
    assert (result.exit_code, "different limits" in result.stderr) == (1, True)
    result = ema("learn-fleet", fleet, "-o", tmp_path / "a.npz", "--limit", "bandwidth=15")
    assert (result.exit_code, "unknown limit 'bandwidth'" in result.stderr) == (2, True)


@pytest.mark.slow
def test_monitor_states_which_fleet_it_uses_and_refuses_an_invalid_fleet(
    site: Path, fleet: Path, tmp_path: Path
):
    folder = tmp_path / "histories"
    folder.mkdir()
    path = history_path(folder, FLAP.actuator_id, FLAP.serial_number)
    history = History(FLAP.actuator_id, FLAP.serial_number, path)
    for number in range(TESTS):
        estimate = made_test(number, seed=9, friction=0.1 + 0.005 * number)
        history.append(Entry(estimate, 10.0 * number, number + 1))
    history.close()
    parameters = {"history_folder": str(folder), "fleet_file": str(fleet)}
    with monitor(parameters) as session:
        session.describe()
        health = session.until(lambda: session.healths())[-1]
        assert health.assumption == (
            "future use as in the past; growth prior from 2 other units (line A)"
        )
        assert health.rul_faults.known
    (tmp_path / "none.npz").write_text("no fleet")
    with monitor(parameters | {"fleet_file": str(tmp_path / "none.npz")}, up=False) as session:
        assert not session.change_state(1)
        session.until_status("lifecycle", "is not a fleet file", b"\2")


def test_prognosis_of_bags_states_which_fleet_it_uses(ema, fleet: Path):
    result = ema("predict", SAMPLE, "--hours-per-cycle", 10, "--fleet", fleet)
    assert result.exit_code == 0, result.output
    assumed = "assumption: future use as in the past; growth prior from 2 other units (line A)"
    assert assumed in result.stdout
