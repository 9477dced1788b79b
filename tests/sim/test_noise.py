"""The noise on the reference current, seen from outside.

The inverter compares: with a locked rotor, next to no band and an inductance that leaves the
current where it is, the driven pair gets +V in a step where bias plus noise is positive and -V
where it is negative. So the mean slope of the current tells the share of positive noise beyond
minus the bias, hence its sigma, and the steps in between tell how long a value is held.
"""

import math
from statistics import NormalDist

import numpy as np
import pytest

from ema_core.parameters import ActuatorParameters
from ema_sim.actuator import SimulatedActuator

COMPARATOR = ActuatorParameters(f_sm=1e4, L_s=0.1, R_s=1e-4, h_b=1e-4, V_max=5e-3, I_max=1e4)
SLOPE = COMPARATOR.V_max / COMPARATOR.L_s
PERIOD = 1e-4
SAMPLES = 2000


def comparisons(noise_gain: float, hold: float, bias: float, **changes: float) -> np.ndarray:
    """Sum of the signs of the holds in each sample, `(SAMPLES,)`."""
    p = COMPARATOR.replace(changes)
    actuator = SimulatedActuator(
        p,
        sample_period=PERIOD,
        noise_gain=noise_gain,
        noise_hold_s=hold,
        rng=np.random.default_rng(23),
    )
    command = bias * p.k_t / (p.GAP * p.G_prop)
    current = []
    for _ in range(SAMPLES + 1):  # in the first one the command gets there
        actuator.advance([command])
        current.append((actuator.state.i_c - actuator.state.i_b) / 2)
    return np.diff(current) / (SLOPE * hold)


@pytest.mark.parametrize(("noise_gain", "hold"), [(1.0, 1e-6), (100.0, 1e-6), (4.0, 1e-5)])
def test_variance_and_hold_time(noise_gain, hold):
    """Variance K_noise 1e-6 / t_n, each value held for t_n and independent of the others."""
    sigma = math.sqrt(noise_gain * 1e-6 / hold)
    holds = round(PERIOD / hold)
    total = comparisons(noise_gain, hold, bias=sigma / 2)
    n = SAMPLES * holds

    share = (1 + total.sum() / n) / 2
    measured = 0.5 * sigma / NormalDist().inv_cdf(share)
    # Five sigma of a share of n: sqrt(p (1 - p) / n) over its slope 0.5 pdf(0.5) / sigma. The
    # current itself moves by up to 4e-3 A, worth 0.6 % of the bias on average: well within.
    p = NormalDist().cdf(0.5)
    deviation = math.sqrt(p * (1 - p) / n) / (0.5 * NormalDist().pdf(0.5))
    assert measured == pytest.approx(sigma, rel=5 * deviation)

    # Signs of whole holds add up to whole numbers; values that change within a hold would not.
    whole = np.rint(total)
    np.testing.assert_allclose(total, whole, atol=0.01)
    assert np.abs(whole).max() <= holds
    # With the parity of their count, but for the rare value inside the band of one leg only.
    assert (whole.astype(int) % 2 != holds % 2).mean() < 0.02
    # Binomial variance, if they are independent; 5 sigma of a variance from that many samples.
    expected = holds * 4 * p * (1 - p)
    assert whole.var() == pytest.approx(expected, rel=5 * math.sqrt(2 / SAMPLES))
