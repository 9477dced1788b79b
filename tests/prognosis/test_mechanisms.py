# SPDX-License-Identifier: Apache-2.0
"""Each mechanism of growth can be switched off, and then does not affect a prediction."""

import numpy as np
import pytest

from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.growth.check import PredictionCheck
from ema_monitor.prognosis.growth.forecast import draw
from ema_monitor.prognosis.growth.mechanisms import MECHANISMS, Mechanisms
from ema_monitor.prognosis.growth.mixture import Mixture
from ema_monitor.prognosis.growth.outliers import OutlierDetector
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_monitor.prognosis.growth.tracker_settings import TrackerSettings

from .tracked_lives import observed

LIMITS, SETTINGS = HealthLimits(), TrackerSettings()


def mixture(mechanisms: Mechanisms) -> Mixture:
    return Mixture(LIMITS, SETTINGS, mechanisms)


def test_all_mechanisms_are_active_by_default():
    whole = mixture(MECHANISMS)
    cells = whole.bank.cells
    assert 0.0 < cells.prior[cells.wanders].sum() < cells.prior.sum()
    assert np.all(whole.waves.prior > 0.0)
    empty = {name for name, part in cells.slices.items() if cells.prior[part].size == 0}
    assert empty == {"exponential"}  # It has the curves of archard.


@pytest.mark.parametrize("law", ["jumps", "logistic"])
def test_disabled_law_has_no_cells(law):
    cells = mixture(Mechanisms(laws=tuple(set(MECHANISMS.laws) - {law}))).bank.cells
    assert cells.prior[cells.slices[law]].size == 0


def test_rates_wander_never_or_always():
    assert not mixture(Mechanisms(wandering=0.0)).bank.cells.wanders.any()
    cells = mixture(Mechanisms(wandering=1.0)).bank.cells
    steady = ~cells.wanders
    steady[cells.slices["constant"]] = False
    assert not steady.any()


def test_waves_without_prior_are_impossible():
    tracker, rng = Tracker(LIMITS, SETTINGS, Mechanisms(wave=0.0)), np.random.default_rng(0)
    for test in range(6):
        tracker.update(observed(10.0 * test, {"friction": 0.01 * test}, rng))
    sample = draw(tracker._mixture, 2000, np.zeros(7), rng)
    assert not sample.is_wave.any()


def test_growth_without_lasting_changes_keeps_its_rate():
    observed_hours, rng = np.full(7, 300.0), np.random.default_rng(0)
    assert np.any(draw(mixture(MECHANISMS), 200, observed_hours, rng).changed != 1.0)
    lasting = mixture(Mechanisms(changed=(1.0, 1.0)))
    assert np.all(draw(lasting, 200, observed_hours, rng).changed == 1.0)


def test_tracker_uses_the_given_detector_and_check():
    class Deaf(OutlierDetector):
        def judge(self, measurement, mean, variance, tests):
            none = np.zeros(len(mean), dtype=bool)
            return [], none, none.copy()

    class Wide(PredictionCheck):
        def widening(self):
            return np.full(7, 2.0)

    trackers = [
        Tracker(LIMITS, SETTINGS),
        Tracker(LIMITS, SETTINGS, outliers=Deaf(SETTINGS)),
        Tracker(LIMITS, SETTINGS, check=Wide(SETTINGS)),
    ]
    events, widths = [], []
    for tracker in trackers:
        rng = np.random.default_rng(1)
        kinds = []
        for test in range(14):
            friction = 0.02 + 0.02 * test + (0.3 if test == 10 else 0.0)
            kinds += [
                event.kind
                for event in tracker.update(observed(10.0 * test, {"friction": friction}, rng))
            ]
        life = tracker.predict().components["friction"]
        events.append(kinds)
        widths.append(np.log(life.hours_95 / life.hours_05))
    assert events == [["outlier"], [], ["outlier"]]
    assert widths[2] == pytest.approx(2.0 * widths[0], rel=0.05)
