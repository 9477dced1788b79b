"""Claims about the electronics, the noise and the calibration."""

from collections.abc import Iterator

import numpy as np

from ema_monitor.residual import rms
from ema_study.claims.claim import (
    Claim,
    falls,
    follows_closely,
    from_to,
    monitor_claim,
    over_degrees,
    rises,
)
from ema_study.response_figures_of_merit import reversal_delays
from ema_study.responses import (
    NOISE_GAINS,
    SEVERITIES,
    chirp_comparison,
    noisy_response,
    reference_response,
    uncalibrated_comparison,
)
from ema_study.sources import THESIS_MODEL


def gain() -> Iterator[Claim]:
    """Yield the claims about the gain (section 4.6)."""
    fault = "gain"
    runs = [reference_response(fault, i, "step") for i in range(len(SEVERITIES[fault]))]
    largest = max(
        float(np.abs(getattr(one, name) - getattr(runs[0], name)).max())
        for one in runs[1:]
        for name in ("position", "speed", "current")
    )
    yield Claim(
        "4.43",
        fault,
        "step",
        "position, speed and current are not affected",
        f"largest difference {largest:.2g}",
        largest == 0.0,
    )
    delays = [
        1e3 * value
        for value in over_degrees(fault, "chirp", lambda one: float(reversal_delays(one).mean()))
    ]
    yield Claim(
        "4.44",
        fault,
        "chirp",
        "the lower the gain, the later the position",
        f"mean delay at a reversal {from_to(delays, 'ms')} from 0.5 × to 1.5 ×",
        falls(delays),
    )
    tops = over_degrees(fault, "chirp", lambda one: float(np.abs(one.speed).max()))
    yield Claim(
        "4.45",
        fault,
        "chirp",
        "the lower the gain, the lower the highest speed",
        f"{from_to(tops, 'rad/s')} from 0.5 × to 1.5 ×",
        rises(tops),
    )
    yield monitor_claim("4.47", fault, "the gain does not affect how it follows", follows_closely)


def noise() -> Iterator[Claim]:
    """Yield the claim about noise (section 4.7)."""
    steps = [rms(np.diff(noisy_response(gain).current)) for gain in NOISE_GAINS[1:]]
    yield Claim(
        "4.50",
        "noise",
        "chirp",
        "the more noise, the more indented the current",
        f"rms from sample to sample {from_to(steps, 'A')} from K = 1 to 100",
        rises(steps),
    )


def calibration() -> Iterator[Claim]:
    """Yield the claim about the calibration (section 6.3)."""
    before = uncalibrated_comparison()
    after = chirp_comparison("none")
    apart, left = (rms(one.reference - one.monitor["thesis"]) for one in (before, after))
    yield Claim(
        "6.4",
        "none",
        "chirp",
        "the models differ slightly, and not once calibrated",
        f"rms {apart:.2g} A before, {left:.1g} A after ({THESIS_MODEL})",
        left < 1e-9 < apart < 0.1 * rms(before.reference),
    )
