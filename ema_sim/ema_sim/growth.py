# SPDX-License-Identifier: Apache-2.0
"""Growth of simulated faults with service hours: one law with its parameters per component.

u is the service time [h], x the distance of a component from its healthy value. Laws are evaluated
by their exact solution, so that the result does not depend on the number of steps.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core.faults import FAULT_NAMES, FAULTS, Fault, fault_vector
from ema_core.growth_laws import EXACT_LAWS, increment
from ema_core.quantity import Checked, quantity, text


@dataclass(frozen=True)
class Growth(Checked):
    """Growth law of a fault component, with its parameters.

    ``linear`` is dx/du = a, ``exponential`` dx/du = a (x + x_0), ``archard`` dx/du = a (1 + b x),
    ``self_heating`` dx/du = a exp(b x), ``power`` x = (u / c)^p and ``drift`` dk = a du + s dW; a
    and c are ``rate``, x_0, b and p are ``shape``, s is ``noise``.

    A component whose healthy value lies inside its range can grow in both directions. It stays on
    its side of the healthy value. From the healthy value, the sign of ``rate`` determines the side;
    its magnitude is the parameter of the law. A drift is signed and may cross the healthy value.
    """

    law: str = text("constant", "growth law of the fault", EXACT_LAWS)
    rate: float = quantity(0.0, "1/h", -1e6, 1e6, "rate a; for the law power, time scale c in h")
    shape: float = quantity(0.0, "-", 0.0, 100.0, "second parameter of the law: x_0, b or p")
    noise: float = quantity(
        0.0, "-", 0.0, 3.0, "sigma of the lognormal factor; for the law drift, s in 1/sqrt(h)"
    )
    """Process noise: standard deviation of the logarithm of a factor with mean 1 on each increment
    [-]; for ``drift``, diffusion s [1/sqrt(h)]."""
    onset: float = quantity(0.0, "h", 0.0, 1e9, "service hour at which growth begins")
    """Start of growth, in service hours after the growth was set [h]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.law == "power":
            if self.rate == 0.0:
                raise ValueError("rate = 0 h: the law power requires a time scale c other than 0")
            if self.shape == 0.0:
                raise ValueError("shape = 0: the law power requires an exponent p above 0")

    @property
    def is_constant(self) -> bool:
        """Whether the component never changes."""
        if self.law == "drift":
            return self.rate == 0.0 and self.noise == 0.0
        return self.law == "constant" or self.rate == 0.0


def check_growths(growths: Mapping[str, Growth]) -> dict[str, Growth]:
    """Validate the growths of components and return them as a dict.

    Raises
    ------
    ValueError
        If a component is unknown, or a rate is negative although the healthy value is 0.
    """
    for name, growth in growths.items():
        if name not in FAULT_NAMES:
            raise ValueError(f"growth of unknown fault {name!r}; known: {', '.join(FAULT_NAMES)}")
        if growth.rate < 0.0 and FAULTS[FAULT_NAMES.index(name)].healthy == 0.0:
            raise ValueError(
                f"growth of {name}: rate = {growth.rate:g}: expected at least 0, because the "
                "healthy value is the lowest value"
            )
    return dict(growths)


def grow(
    faults: Mapping[str, float] | ArrayLike,
    growths: Mapping[str, Growth],
    hours_before: float,
    hours_step: float,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Return a fault vector after further service hours.

    Parameters
    ----------
    faults
        Fault vector before, in any form that ``ema_core.faults.fault_vector`` accepts.
    growths
        Growth, keyed by component; components without an entry stay constant.
    hours_before
        Service hours from the setting of the growths to the step [h]; ``onset`` counts from there.
    hours_step
        Further service hours [h].
    rng
        Random generator for the process noise.

    Returns
    -------
    numpy.ndarray
        Fault vector after the step, ``(8,)``, within its range.

    Raises
    ------
    ValueError
        If the vector or the growths are invalid, or ``hours_step`` is negative or not finite.
    """
    if not 0.0 <= hours_step < math.inf:
        raise ValueError(f"hours_step = {hours_step:g} h: expected a number of at least 0")
    k = fault_vector(faults)
    growths = check_growths(growths)
    # The fixed order makes the result for a seed independent of the order of `growths`.
    for i, fault in enumerate(FAULTS):
        growth = growths.get(fault.name)
        if growth is None or growth.is_constant:
            continue
        hours = min(hours_step, hours_before + hours_step - growth.onset)
        if hours > 0.0:
            k[i] = _grown(fault, growth, float(k[i]), hours, rng)
    return k


def _grown(fault: Fault, growth: Growth, k: float, hours: float, rng: np.random.Generator) -> float:
    if growth.law == "drift":
        step = growth.rate * hours + growth.noise * math.sqrt(hours) * rng.standard_normal()
        return min(max(k + step, 0.0), fault.highest)
    side = math.copysign(1.0, k - fault.healthy if k != fault.healthy else growth.rate)
    step = float(
        increment(growth.law, abs(k - fault.healthy), abs(growth.rate), growth.shape, hours)
    )
    if growth.noise > 0.0:
        # The mean is 1, so that noise does not change the mean rate of growth.
        step *= math.exp(growth.noise * rng.standard_normal() - growth.noise**2 / 2.0)
    return min(max(k + side * step, 0.0), fault.highest)
