# SPDX-License-Identifier: Apache-2.0
"""Growth learned from units: combined, stored in a file, and used for the next unit."""

from pathlib import Path

import numpy as np
import pytest

from ema_core.faults import kind_of
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.fleet_growth import FleetGrowth, UnitGrowth, fleet_of
from ema_monitor.prognosis.growth.cells import grid
from ema_monitor.prognosis.growth.fleet_prior import (
    GrownFault,
    curves_without_fleet,
    distribution,
    grid_digest,
    with_fleet,
)
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_monitor.prognosis.growth.tracker_settings import TrackerSettings, known_law
from ema_monitor.prognosis.history import History, history_path, read_history
from ema_monitor.prognosis.history_entry import Entry
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import KEPT_EVERY, Unit
from ema_sim.growth import Growth

from .made_tests import history_of, made_test
from .tracked_lives import feed

LIMITS = HealthLimits()
GRID = grid_digest(LIMITS)
BEFORE = curves_without_fleet(LIMITS)


def grown(rate: float, seed: int) -> UnitGrowth:
    """Return the growth of a unit with growing friction."""
    tracker = Tracker()
    growth = {"friction": Growth("linear", rate)}
    feed(tracker, growth, 900.0, np.random.default_rng(seed), every=20.0)
    return UnitGrowth(tracker.updates, tuple(tracker.grown_faults().values()))


@pytest.fixture(scope="module")
def units() -> dict[str, UnitGrowth]:
    rates = 5e-4 * np.exp(0.1 * np.random.default_rng(0).standard_normal(8))
    return {str(seed): grown(rate, seed) for seed, rate in enumerate(rates)}


def flap(serial: str, path: Path | None = None, n: int = 40) -> History:
    """Return the history of a unit whose friction has grown."""
    tests = (made_test(test, seed=int(serial), friction=0.005 * test) for test in range(n))
    return history_of(tests, path, ("flap", serial))


def test_parts_combined_in_any_order_give_the_bit_identical_whole(units):
    whole = FleetGrowth(GRID, units).prior(LIMITS)
    names = list(units)
    first, second = (
        FleetGrowth(GRID, {name: units[name] for name in half}) for half in (names[:3], names[2:])
    )
    for both in (first.together(second), second.together(first)):
        prior = both.prior(LIMITS)
        assert prior == whole
        assert (prior.units, prior.counts) == (8, {"friction": 8})
        np.testing.assert_array_equal(prior.shares["friction"], whole.shares["friction"])


def test_unit_in_two_parts_counts_with_the_part_that_has_more_tests(units):
    early = UnitGrowth(3, ())
    for first, second in (({"a": early}, {"a": units["0"]}), ({"a": units["0"]}, {"a": early})):
        assert FleetGrowth(GRID, first).together(FleetGrowth(GRID, second)).units["a"] is units["0"]


def test_distribution_follows_the_units_and_keeps_a_share_of_the_prior():
    before = BEFORE["friction"]
    log = np.full(before.shape, -30.0, dtype=np.float16)
    log[5, 14] = 0.0
    for n, least in ((1, 0.008), (100, 0.17)):  # at most the fifth that the fleet contributes
        share = distribution([log] * n, before)
        assert share.sum() == pytest.approx(1.0)
        # Neighbouring rates are likely within the width of the smoothing, 0.25 of the logarithm.
        assert share[5, 11:18].sum() > least
        assert np.all(share > 0.79 * before)
    # A unit without information changes nothing.
    np.testing.assert_allclose(distribution([np.zeros_like(log)] * 20, before), before, rtol=1e-6)


def test_fleet_improves_the_prediction_of_similar_units_and_does_not_harm_others(units):
    prior = FleetGrowth(GRID, units).prior(LIMITS)

    def life(rate: float, until: float, with_fleet: bool) -> tuple[bool, float, float]:
        tracker = Tracker(LIMITS, TrackerSettings(fleet=prior if with_fleet else None))
        feed(tracker, {"friction": Growth("linear", rate)}, until, np.random.default_rng(99))
        overall = tracker.predict().overall
        return overall.known, overall.hours_50, overall.hours_95 - overall.hours_05

    # The same kind, after 300 h of its life of 1,000 h.
    is_known, median, width = life(5e-4, 300.0, True)
    _, median_without, width_without = life(5e-4, 300.0, False)
    assert is_known
    assert abs(median - 700.0) <= 0.5 * abs(median_without - 700.0)
    assert width < width_without
    # A unit that grows four times as fast is predicted all the same: 250 h of life, after 130 h.
    is_known, median, _ = life(2e-3, 130.0, True)
    assert is_known
    assert median == pytest.approx(120.0, rel=0.15)


def test_file_restores_the_growth_and_contains_no_unit_name(tmp_path: Path):
    histories = [flap(serial) for serial in ("1", "2")]
    fleet = fleet_of(histories, LIMITS, "line A")
    path = tmp_path / "fleet.npz"
    fleet.write(path)
    again = FleetGrowth.read(path)
    assert again.prior(LIMITS) == fleet.prior(LIMITS)
    assert again.prior(LIMITS).text() == "growth prior from 2 other units (line A)"
    with np.load(path) as file:
        texts = [str(value) for value in (*file["units"], *file["names"], file["grid"])]
    assert not any("flap" in text for text in texts)
    assert "line A" in texts
    # A unit's own tests do not count twice.
    assert again.prior(LIMITS, without=("flap", "2")).units == 1
    assert again.prior(LIMITS, without=("flap", "3")).units == 2


@pytest.mark.parametrize(
    ("content", "reason"),
    [(b"", "No data left"), (b"PK\x03\x04 no archive", "zip"), (b"tests, hours", "pickled")],
)
def test_file_that_is_not_a_fleet_is_refused_by_name(tmp_path: Path, content, reason):
    path = tmp_path / "fleet.npz"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=f"{path} is not a fleet file: .*{reason}"):
        FleetGrowth.read(path)


def test_arrays_of_a_wrong_kind_are_refused_by_name(tmp_path: Path, units):
    path = tmp_path / "fleet.npz"
    FleetGrowth(GRID, units).write(path)
    with np.load(path) as file:
        arrays = dict(file)
    for change, reason in (
        ({"growth.friction": arrays["growth.friction"][:, :, :-1]}, "the shape"),
        ({"growth.friction": arrays["growth.friction"] * np.float16(np.nan)}, "impossible values"),
        ({"growth.friction": arrays["growth.friction"] - np.float16(30.0)}, "impossible values"),
        ({"growth.wear": arrays["growth.friction"]}, "unknown kind of fault 'wear'"),
        ({"format": np.array(2)}, "format 2, expected 1"),
        ({"tests": arrays["tests"][:-1]}, "shorter"),
    ):
        np.savez(path, **{**arrays, **change})
        with pytest.raises(ValueError, match=f"{path} is not a fleet file: .*{reason}"):
            FleetGrowth.read(path)
    del arrays["grid"]
    np.savez(path, **arrays)
    with pytest.raises(ValueError, match="is not a fleet file: 'grid"):
        FleetGrowth.read(path)


def test_different_limits_are_refused_and_reported_and_the_prognosis_continues(units):
    fleet = FleetGrowth(GRID, units)
    limits = HealthLimits(friction=0.3)
    with pytest.raises(ValueError, match="different limits"):
        fleet.prior(limits)
    with pytest.raises(ValueError, match="different limits"):
        fleet.together(FleetGrowth(grid_digest(limits)))
    history = flap("1")
    settings = PrognosisSettings(limits=limits, fleet=fleet)
    outlook = Unit(history, settings).resume(None, settings)
    assert outlook is not None
    assert "the fleet is not used: the fleet has different limits" in outlook.assumption
    assert outlook.rul_faults.known


def test_outlook_states_its_fleet_and_a_restart_continues_with_it(tmp_path: Path, units):
    path = history_path(tmp_path, "flap", "1")
    flap("1", path, KEPT_EVERY).close()
    settings = PrognosisSettings(fleet=FleetGrowth(GRID, units, frozenset(["line A"])))

    def opened(with_settings: PrognosisSettings) -> Unit:
        prognostics = Unit(History("flap", "1", path), with_settings)
        prognostics.write()
        prognostics.history.close()
        return prognostics

    first, second = opened(settings), opened(settings)
    outlook = second.resume(None, settings)
    assert outlook is not None
    assert outlook.assumption.endswith("; growth prior from 8 other units (line A)")
    assert second.growth.kept_tests == KEPT_EVERY
    again = first.resume(None, settings)
    assert again is not None
    assert outlook.rul_faults == again.rul_faults
    # Growth stored with a fleet is not used without it, nor with another fleet.
    plain = PrognosisSettings()
    assert opened(plain).growth.kept_tests == 0
    fewer = FleetGrowth(GRID, {name: units[name] for name in list(units)[:4]})
    assert opened(PrognosisSettings(fleet=fewer)).growth.kept_tests == 0
    without = second.resume(None, plain)
    assert without is not None
    assert without.assumption == "future use as in the past"


def test_history_is_read_without_a_change_while_a_monitor_uses_it(tmp_path: Path):
    path = history_path(tmp_path, "left/flap", "1")
    path.parent.mkdir(exist_ok=True)
    in_use = History("left/flap", "1", path)
    in_use.append(Entry(made_test(0, friction=0.1), 0.0, 1))
    before = path.read_bytes()
    read = read_history(path)
    assert (read.unit, len(read.entries)) == (("left/flap", "1"), 1)
    assert path.read_bytes() == before
    in_use.close()
    with pytest.raises(ValueError, match=r"expected a file name of the form ACTUATOR\+SERIAL"):
        read_history(tmp_path / "fleet.npz")
    damaged = history_path(tmp_path, "flap", "2")
    damaged.write_bytes(b"no database" * 100)
    with pytest.raises(ValueError, match=str(damaged).replace("+", "\\+")):
        read_history(damaged)
    assert damaged.exists()


def test_only_growing_faults_contribute_growth():
    tracker = Tracker()
    feed(tracker, {}, 300.0, np.random.default_rng(0), {"friction": 0.2})
    assert tracker.grown_faults() == {}
    feed(
        tracker, {"backlash": Growth("linear", 1e-3)}, 700.0, np.random.default_rng(1), after=300.0
    )
    faults = tracker.grown_faults()
    assert [*faults] == ["backlash"]
    fault = faults["backlash"]
    assert fault.kind == kind_of("backlash")
    assert isinstance(fault, GrownFault)
    assert fault.log_likelihood.max() == 0.0
    assert fault.log_likelihood.shape == BEFORE["backlash"].shape


def test_repaired_unit_contributes_the_growth_before_and_after_its_repair():
    tests = [made_test(test, seed=test, friction=0.01 * (test % 30)) for test in range(60)]
    [unit] = fleet_of([history_of(tests)], LIMITS).units.values()
    assert [fault.kind for fault in unit.faults] == ["friction", "friction"]
    before, after = (fault.log_likelihood for fault in unit.faults)
    [first] = fleet_of([history_of(tests[:30])], LIMITS).units.values()
    assert np.array_equal(first.faults[0].log_likelihood, before)
    assert not np.array_equal(after, before)


def test_units_share_a_grid_that_no_fleet_changes() -> None:
    limits = HealthLimits()
    cells = grid(limits, TrackerSettings())
    prior = cells.prior.copy()
    assert grid(HealthLimits(), TrackerSettings()) is cells
    assert grid(HealthLimits(friction=2.0 * limits.friction), TrackerSettings()) is not cells
    laws = {"friction": known_law("friction", "linear:1e-3")}
    assert grid(limits, TrackerSettings(laws=laws)) is not cells
    with pytest.raises(ValueError, match="read-only"):
        cells.prior[0] = 0.0
    assert np.array_equal(with_fleet(cells, TrackerSettings()).prior, prior)
