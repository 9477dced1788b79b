# SPDX-License-Identifier: Apache-2.0
"""The estimate of several stretches describes all of them, not only the last."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ema_core.causes import CauseEstimate
from ema_core.faults import FAULT_NAMES, N_FAULTS
from ema_monitor.identification.alternatives import Alternative
from ema_monitor.identification.estimate import Estimate, Verdict
from ema_monitor.identification.estimate_of_stretches import combined_estimate
from ema_monitor.identification.inference import WindowResult
from ema_monitor.identification.knowledge import Knowledge
from ema_monitor.identification.uncertainty import USUAL_MISFIT
from ema_monitor.identification.verdict import Misfit
from ema_monitor.reason_texts import EQUAL_SHORTS
from ema_monitor.reasons import NotConverged, OtherUnit

from .windows import estimated

SHORTS = slice(2, 5)
SIGMA = 0.01
KNOWN = Knowledge(np.zeros(N_FAULTS), 1e-6 * np.eye(N_FAULTS))


def estimate(number: int, *kept: str, **values: Any) -> Estimate:
    """Return the estimate of a stretch with some significant faults."""
    return estimated(
        dict.fromkeys(kept, 0.1),
        insignificant=~np.isin(FAULT_NAMES, kept),
        start_ns=10 * number,
        end_ns=10 * number + 9,
        play_offset=0.5 - number,
        fitness=1.0,
        excitation=0.01,
        verdict=Verdict.VALID,
        **values,
    )


def part(
    stretch: Estimate, *, power: float = 1.0, departure: float = 100.0, **more
) -> WindowResult:
    misfit = Misfit(np.array([[power, departure], [1.0, departure]]))
    return WindowResult(replace(stretch, goodness_of_fit=misfit.goodness), misfit, **more)


def combined(*parts: WindowResult, wanted_sigma: float = 0.05) -> Estimate:
    result = combined_estimate(parts, KNOWN, wanted_sigma)
    assert result is not None
    return result


def test_cause_of_any_stretch_is_named_with_its_range():
    load = [CauseEstimate("load_torque", value, 0.01) for value in (0.3, 0.1)]
    offset = CauseEstimate("current_offset", 0.2, 0.02)
    result = combined(
        part(estimate(0, causes=(load[0], offset))),
        part(estimate(1, causes=(load[1],))),
        part(estimate(2)),
    )
    assert result.causes == (load[0], offset)
    assert "load torque +0.3 ± 0.01 N.m (+0.1 to +0.3 N.m, in 2 of 3 stretches)" in result.reason
    assert "current sensor offset +0.2 ± 0.02 A (in 1 of 3 stretches)" in result.reason


def test_goodness_is_that_of_all_stretches_together():
    """It is the root of the mean power, so a good last stretch does not hide a poor one."""
    result = combined(part(estimate(0), power=31.0), part(estimate(1), power=1.0))
    assert result.goodness_of_fit == pytest.approx(4.0)
    assert result.unexplained_share == pytest.approx(math.sqrt(15.0 / 198.0))
    assert result.verdict == "degraded"
    assert "the residual is 4.0 times the residual of a healthy actuator" in result.reason
    # The last stretch alone is no reason to widen sigma; beyond 2, sigma grows with the goodness.
    np.testing.assert_allclose(result.sigma, SIGMA * 4.0 / USUAL_MISFIT)


def test_motion_that_nothing_explains_is_refused():
    """If one stretch fits poorly, 17 % of the departure is unexplained; if both do, 62 %."""
    result = combined(part(estimate(0), power=31.0, departure=400.0), part(estimate(1)))
    assert (result.verdict, result.valid) == ("degraded", True)
    result = combined(*(part(estimate(i), power=31.0, departure=40.0) for i in range(2)))
    assert (result.verdict, result.valid) == ("refused", False)
    assert "neither faults nor known causes explain the motion" in result.reason


def test_faults_that_a_stretch_could_not_separate_do_not_average_out():
    """A lower torque constant is mistaken for inertia, then for equal short circuits."""
    kept = [FAULT_NAMES[i] for i in (2, 3, 4)]
    inertia = CauseEstimate("inertia", 0.06, 0.05)
    pair = Alternative(("inertia",), EQUAL_SHORTS)
    unsure = estimate(0, sigma=0.04, causes=(inertia,), alternatives=(pair,))
    result = combined(part(unsure), part(estimate(1, *kept)))
    assert result.alternatives == (pair,)
    assert result.verdict == "degraded"
    assert "this motion cannot separate inertia from equal short circuits" in result.reason
    np.testing.assert_allclose(np.array(result.sigma)[SHORTS], 0.04)
    assert result.sigma.friction == pytest.approx(SIGMA)
    # The wanted accuracy is then not reached.
    result = combined(part(unsure), part(estimate(1, *kept)), wanted_sigma=0.02)
    assert np.all(result.unobservable[SHORTS])
    assert "the motion does not show short circuit A, short circuit B" in result.reason


def test_confusion_without_remaining_parts_is_dropped():
    pair = Alternative(("friction",), ("current_offset",))
    first = estimate(0, "friction", alternatives=(pair,))
    for sigma in (SIGMA, 0.12):  # Within its sigma of healthy, the part may still be present.
        last = part(estimate(1, "friction", sigma=sigma))
        assert combined(part(first), last, wanted_sigma=0.5).alternatives == (pair,)
    result = combined(part(first), part(estimate(1, "backlash")))
    assert (result.alternatives, result.verdict) == ((), "valid")


def test_temporary_cause_leaves_the_faults_as_estimated():
    """It occurs in one stretch of three. Short circuits would have lasted."""
    inertia = CauseEstimate("inertia", 0.06, 0.05)
    unsure = estimate(0, causes=(inertia,), alternatives=(Alternative(("inertia",), EQUAL_SHORTS),))
    result = combined(part(unsure), *(part(estimate(i)) for i in (1, 2)))
    assert (result.alternatives, result.verdict, result.causes) == ((), "valid", (inertia,))


def test_remarks_of_stretches_appear_once_with_their_number():
    wrong = [CauseEstimate("load_torque", value, 0.01) for value in (0.1, 0.12)]
    slow, forced = NotConverged(), OtherUnit((("serial_number", "B", "A"),), forced=True)
    parts = [
        part(estimate(i), contradicted=(cause,), caveats=(forced, *more))
        for i, (cause, more) in enumerate(zip(wrong, ((slow,), ()), strict=True))
    ]
    reason = combined(*parts).reason
    assert reason.split("; ") == [
        "not used, as the motion contradicts it: measured load torque +0.12 ± 0.01 N.m "
        "(in 2 of 2 stretches)",
        "forced although the actuator has serial number 'B', the calibration was made on 'A': "
        "run `ema calibrate` for this unit",
        "the search was stopped before it converged (in 1 of 2 stretches)",
    ]


def test_position_in_the_play_and_cost_describe_all_stretches():
    """The play is the position at the start, the cost is the sum of all costs."""
    result = combined(part(estimate(0)), part(estimate(1)))
    assert (result.play_offset, result.fitness, result.stretches) == (0.5, 2.0, 2)
    assert (result.start_ns, result.end_ns) == (0, 19)


def test_unknown_goodness_widens_sigma():
    """A single healthy window gives no scatter: sigma is as wide as for the worst valid fit."""
    blind = replace(estimate(0), goodness_of_fit=math.nan)
    parts = [
        replace(part(blind), misfit=Misfit(np.full((2, 2), np.nan)), estimate=blind)
        for _ in range(2)
    ]
    result = combined(*parts)
    assert (result.verdict, result.valid) == ("degraded", True)
    assert "the fit cannot be judged" in result.reason
