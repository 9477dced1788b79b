"""Claims about the motor: short circuit and eccentricity."""

from collections.abc import Iterator

import numpy as np

from ema_monitor.residual import rms
from ema_study.claims.claim import (
    Claim,
    agrees_with,
    follows_closely,
    from_to,
    is_nominal,
    monitor_claim,
    over_degrees,
    position_claim,
    range_agrees,
    rises,
)
from ema_study.response_figures_of_merit import phase_a_is_fed, ripple, rise_time, steady
from ema_study.responses import reference_response, times


def short_circuit() -> Iterator[Claim]:
    """Yield the claims about the short circuit (section 4.4)."""
    fault = "short_circuit"
    after_start = round(0.02 / times(2)[1])
    starts = over_degrees(fault, "step", lambda one: float(one.speed[after_start]))
    yield Claim(
        "4.23",
        fault,
        "step",
        "the motor starts slightly worse",
        f"speed 10 ms after the step {starts[0]:.0f} rad/s nominal, {starts[2]:.0f} at 50 %, "
        f"{starts[-1]:.0f} at 99 %",
        max(starts[1:]) < starts[0],
    )
    speeds = over_degrees(fault, "step", lambda one: float(steady(one.speed).mean()))
    yield Claim(
        "4.23",
        fault,
        "step",
        "the steady speed is higher",
        f"mean {from_to(speeds, 'rad/s')}",
        rises(speeds),
    )
    ripples = over_degrees(fault, "step", lambda one: float(steady(one.speed).std()))
    yield Claim(
        "4.23",
        fault,
        "step",
        "the speed becomes intermittent",
        f"standard deviation {from_to(ripples, 'rad/s')}",
        rises(ripples),
    )
    ripples = over_degrees(fault, "step", lambda one: float(steady(one.current).std()))
    yield Claim(
        "4.24",
        fault,
        "step",
        "the current becomes inconstant",
        f"standard deviation {from_to(ripples, 'A')}",
        rises(ripples),
    )
    yield position_claim(fault, "4.26")
    healthy, half = (reference_response(fault, i, "chirp") for i in (0, 2))
    fed = phase_a_is_fed(half)
    more, same = (rms(half.current[at]) / rms(healthy.current[at]) for at in (fed, ~fed))
    yield Claim(
        "4.28",
        fault,
        "chirp",
        "the current rises while the faulty phase is fed",
        f"rms at 50 % {more:.2f} × nominal while A is fed ({100 * fed.mean():.0f} % of the time)",
        more > 1.0 and not is_nominal(more),
    )
    yield Claim(
        "4.28",
        fault,
        "chirp",
        "it is nominal while the other two phases are",
        f"rms at 50 % {same:.2f} × nominal",
        is_nominal(same),
    )
    yield monitor_claim("4.29", fault, "the monitor follows very well", follows_closely)


def eccentricity() -> Iterator[Claim]:
    """Yield the claims about eccentricity (section 4.5)."""
    fault = "eccentricity"
    ripples = over_degrees(fault, "step", lambda one: float(steady(one.speed).std()))
    yield Claim(
        "4.36",
        fault,
        "step",
        "the speed ripples as with a short circuit",
        f"standard deviation {from_to(ripples, 'rad/s')}",
        rises(ripples),
    )
    tops, shorted = (
        over_degrees(one, "step", lambda run: float(run.speed.max()))
        for one in (fault, "short_circuit")
    )
    yield Claim(
        "4.36",
        fault,
        "step",
        "the highest speed is lower than with a short circuit",
        f"at 50 % {tops[2]:.3g} and {shorted[2]:.3g} rad/s",
        all(a < b for a, b in zip(tops[1:], shorted[1:], strict=True)),
    )
    slow, quick = (
        [1e3 * value for value in over_degrees(one, "step", rise_time)]
        for one in (fault, "short_circuit")
    )
    yield Claim(
        "4.36",
        fault,
        "step",
        "the speed takes longer to rise than with a short circuit",
        f"to 63 % at 50 %: {slow[2]:.3g} and {quick[2]:.3g} ms",
        all(a > b for a, b in zip(slow[1:], quick[1:], strict=True)),
    )
    means = over_degrees(fault, "step", lambda one: float(steady(one.current).mean()))
    yield Claim(
        "4.37",
        fault,
        "step",
        "the mean of the current stays nominal",
        f"steady mean {from_to(means, 'A')}",
        all(is_nominal(mean / means[0]) for mean in means[1:]),
    )
    mine, shorted = (
        over_degrees(one, "step", lambda run: float(steady(run.current).std()))
        for one in (fault, "short_circuit")
    )
    yield Claim(
        "4.37",
        fault,
        "step",
        "the current ripples more than with a short circuit",
        f"standard deviation {mine[2]:.2f} and {shorted[2]:.2f} A at 50 %, {mine[3]:.2f} and "
        f"{shorted[3]:.2f} A at 75 %",
        all(a > b for a, b in zip(mine[1:], shorted[1:], strict=True)),
    )
    peaks = over_degrees(fault, "step", lambda one: float(np.abs(one.current).max()))
    yield Claim(
        "4.37", fault, "step", "the peak of the current grows", from_to(peaks, "A"), rises(peaks)
    )
    yield position_claim(fault, "4.38")
    ripples = over_degrees(fault, "chirp", lambda one: ripple(one.current))
    yield Claim(
        "4.39",
        fault,
        "chirp",
        "the current ripples more",
        f"rms about its mean of 5 ms {from_to(ripples, 'A')}",
        rises(ripples),
    )
    yield monitor_claim(
        "4.40",
        fault,
        "the monitor differs by 7 % at the start, by 2 % after 0.1 s",
        lambda found: agrees_with(found[0], 7.0) and range_agrees(found[1:], (2.0, 2.0)),
    )
