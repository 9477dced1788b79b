"""Claims about the mechanics: friction and backlash."""

from collections.abc import Iterator

import numpy as np

from ema_monitor.residual import rms
from ema_study.claims.claim import (
    AGREEING_SHARE,
    ALIKE_PERCENT,
    Claim,
    falls,
    follows_closely,
    from_to,
    monitor_claim,
    over_degrees,
    position_claim,
    range_agrees,
    rises,
)
from ema_study.response_figures_of_merit import (
    START_S,
    deviations,
    lags,
    reversal_delays,
    rise_time,
    standstill,
    start_and_rest,
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
    found = np.array(rows)
    yield Claim(
        "4.6",
        fault,
        "step",
        "the monitor differs by 2 to 12 %, nominal and doubled",
        f"{found.min():.1f} to {found.max():.1f} % in each 0.1 s ({THESIS_MODEL})",
        range_agrees(found, (2.0, 12.0)),
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
    yield monitor_claim(
        "4.10",
        fault,
        "the monitor differs by 1 to 6 %",
        lambda found: range_agrees(found, (1.0, 6.0)),
    )


def backlash() -> Iterator[Claim]:
    """Yield the claims about backlash (section 4.3)."""
    fault = "backlash"
    healthy, worst = (reference_response(fault, i, "step") for i in (0, -1))
    at_start, later = (100.0 * part.max() for part in start_and_rest(lags(healthy, worst)))
    yield Claim(
        "4.14",
        fault,
        "step",
        "only the start of the position is slightly delayed",
        f"100 × falls short of the nominal position by up to {at_start:.3g} % of it in the first "
        f"{1e3 * START_S:.0f} ms, by up to {later:.2g} % thereafter",
        bool(later < ALIKE_PERCENT < at_start),
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
        all(
            abs(found / claimed - 1.0) <= AGREEING_SHARE
            for found, claimed in ((delays[1][0], 22.0), (delays[0][0], 8.0), (ratios[0], 2.75))
        ),
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
    yield monitor_claim("4.19", fault, "the monitor follows very well", follows_closely)
