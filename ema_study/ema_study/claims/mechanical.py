"""Claims about the mechanics: friction and backlash."""

from collections.abc import Iterator

import numpy as np

from ema_monitor.residual import rms
from ema_study.claims.claim import (
    ALIKE_PERCENT,
    Claim,
    falls,
    from_to,
    monitor_claim,
    over_degrees,
    position_claim,
    rises,
)
from ema_study.response_figures_of_merit import (
    deviations,
    reversal_delays,
    rise_time,
    standstill,
    steady,
)
from ema_study.responses import reference_response, step_comparison
from ema_study.sources import THESIS_MODEL


def friction() -> Iterator[Claim]:
    """Yield the claims about friction (section 4.2)."""
    fault = "friction"
    ends = over_degrees(fault, "step", lambda one: float(one.position[-1]))
    yield Claim(
        "4.3",
        fault,
        "step",
        "the position rises more slowly",
        f"after 0.5 s {from_to(ends, 'rad')}",
        falls(ends),
    )
    speeds = over_degrees(fault, "step", lambda one: float(steady(one.speed).mean()))
    yield Claim(
        "4.4",
        fault,
        "step",
        "the highest speed falls",
        f"steady mean {from_to(speeds, 'rad/s')}",
        falls(speeds),
    )
    rise_ms = [1e3 * value for value in over_degrees(fault, "step", rise_time)]
    yield Claim(
        "4.4",
        fault,
        "step",
        "the time constant grows",
        f"time to 63 % of the steady speed {from_to(rise_ms, 'ms')}",
        rises(rise_ms),
    )
    currents = over_degrees(fault, "step", lambda one: float(steady(one.current).mean()))
    yield Claim(
        "4.5",
        fault,
        "step",
        "more current is needed to hold the speed",
        f"steady mean {from_to(currents, 'A')}",
        rises(currents),
    )
    rows = [
        deviations(one.reference, one.monitor["thesis"]) for one in map(step_comparison, (0, 2))
    ]
    low, high = np.min(rows), np.max(rows)
    yield Claim(
        "4.6",
        fault,
        "step",
        "the monitor differs by 2 to 12 %, nominal and doubled",
        f"{low:.1f} to {high:.1f} % ({THESIS_MODEL})",
        bool(high <= 12.0),
    )
    yield position_claim(fault, "4.7")
    still = [1e3 * value for value in over_degrees(fault, "chirp", standstill)]
    yield Claim(
        "4.8",
        fault,
        "chirp",
        "the motor takes longer to turn round",
        f"time slower than 1 rad/s {from_to(still, 'ms')}",
        rises(still),
    )
    currents = over_degrees(fault, "chirp", lambda one: rms(one.current))
    yield Claim(
        "4.9",
        fault,
        "chirp",
        "more current is needed",
        f"rms {from_to(currents, 'A')}",
        rises(currents),
    )
    first, last = (reference_response(fault, i, "chirp").current[1:] for i in (0, -1))
    apart = deviations(first, last)
    yield Claim(
        "4.9",
        fault,
        "chirp",
        "the currents become more alike as the frequency grows",
        f"3 × and nominal differ by {apart[0]:.0f} % in the first 0.1 s, by {apart[-1]:.0f} % "
        "in the last",
        bool(apart[-1] < apart[0]),
    )
    yield monitor_claim("4.10", fault, "the monitor differs by 1 to 6 %", 6.0)


def backlash() -> Iterator[Claim]:
    """Yield the claims about backlash (section 4.3)."""
    fault = "backlash"
    healthy, worst = (reference_response(fault, i, "step") for i in (0, -1))
    shift = float(np.abs(worst.position - healthy.position).max())
    yield Claim(
        "4.14",
        fault,
        "step",
        "only the start of the position is slightly delayed",
        f"100 × lags by at most {1e3 * shift:.3g} mrad of {healthy.position[-1]:.3g} rad",
        100.0 * shift / healthy.position[-1] < ALIKE_PERCENT,
    )
    speed = float(np.abs(worst.speed - healthy.speed).max())
    current = float(np.abs(worst.current - healthy.current).max())
    yield Claim(
        "4.15",
        fault,
        "step",
        "speed and current do not change",
        f"largest differences {speed:.2g} rad/s and {current:.2g} A",
        speed == 0.0 and current == 0.0,
    )
    healthy, worst = (reference_response(fault, i, "chirp") for i in (0, -1))
    delays = [1e3 * reversal_delays(one) for one in (healthy, worst)]
    ratios = delays[1] / delays[0]
    yield Claim(
        "4.16",
        fault,
        "chirp",
        "the first reversal comes 22 ms late instead of 8 ms (2.75 ×)",
        f"{delays[1][0]:.1f} ms instead of {delays[0][0]:.1f} ms ({ratios[0]:.2f} ×)",
        abs(delays[0][0] / 8.0 - 1.0) < 0.25 and abs(delays[1][0] / 22.0 - 1.0) < 0.25,
    )
    yield Claim(
        "4.16",
        fault,
        "chirp",
        "that ratio falls as the frequency grows",
        f"{ratios[0]:.2f} × at the first reversal, {ratios[-1]:.2f} × at the last",
        bool(ratios[-1] < ratios[0]),
    )
    speeds = over_degrees(fault, "chirp", lambda one: rms(one.speed))
    yield Claim(
        "4.17", fault, "chirp", "the speed grows", f"rms {from_to(speeds, 'rad/s')}", rises(speeds)
    )
    peaks = over_degrees(fault, "chirp", lambda one: float(np.abs(one.current).max()))
    more = 100.0 * (peaks[-1] / peaks[0] - 1.0)
    yield Claim(
        "4.18",
        fault,
        "chirp",
        "the current rises by 70 to 100 %",
        f"peak {from_to(peaks, 'A')} (+{more:.0f} %)",
        70.0 <= more <= 100.0,
    )
    yield monitor_claim("4.19", fault, "the monitor follows very well", ALIKE_PERCENT)
