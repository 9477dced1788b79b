"""Remaining useful life by NASA's progpy: its particle filter and Monte Carlo prediction.

It is given more than our tracker: which component dominates and to which side it goes, its law, and
the hours up to which growth may begin. It looks at that component alone, with its rate and its
onset as further states. Tests in which the component was put back to healthy are kept from it:
taken for a measured zero they made it believe in rates that its particles never came back from.
The rest is as a user would set it up: 1,000 particles, a little jitter on the rate against their
impoverishment, 100 samples a prediction. Of each prediction only the times of the event are kept,
and the model is compiled: with the same random numbers it predicts the same in a sixth of the time
that a model in numpy takes.
"""

import time
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from progpy import PrognosticsModel  # pyright: ignore[reportMissingImports]
from progpy.predictors import MonteCarlo  # pyright: ignore[reportMissingImports]
from progpy.state_estimators import ParticleFilter  # pyright: ignore[reportMissingImports]
from progpy.uncertain_data import UnweightedSamples  # pyright: ignore[reportMissingImports]

from ema_core._jit import kernel
from ema_core.faults import FAULT_NAMES, TYPICAL, healthy_faults, kind_of
from ema_core.growth_laws import LAWS, TypicalGrowth
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_sim.lives import LifeSettings, SimulatedLife
from prognosis.lives import LIMITS
from prognosis.predictors import Predictions

PARTICLES: Final = 1000
SAMPLES: Final = 100
JITTER: Final = 0.01
"""Standard deviation of a random walk of the rate's logarithm [1/sqrt(test)]."""

_HORIZON_HOURS: Final = 4000.0
_STEPS: Final = 50
_INTERVAL_HOURS: Final = LifeSettings().interval_hours
_EXPONENTIAL: Final = LAWS.index("exponential")
_ARCHARD: Final = LAWS.index("archard")
_SELF_HEATING: Final = LAWS.index("self_heating")
_DRIFT: Final = LAWS.index("drift")


class FaultGrowth(PrognosticsModel):
    """One component: distance from healthy, logarithm of the rate, hours left until the onset."""

    inputs: list[str] = []  # noqa: RUF012 - as progpy wants it
    states = ["x", "log_rate", "waiting"]  # noqa: RUF012
    outputs = ["x"]  # noqa: RUF012
    events = ["limit"]  # noqa: RUF012
    is_vectorized = True
    default_parameters = {  # noqa: RUF012
        "process_noise": 0.0,
        "x0": {"x": 0.0, "log_rate": 0.0, "waiting": 0.0},
    }

    def __init__(self, typical: TypicalGrowth, limit: float, rng: np.random.Generator) -> None:
        super().__init__()
        # Not among progpy's parameters, where a look-up costs as much as a step.
        law, noise = LAWS.index(typical.law), LifeSettings().process_noise
        self._growth = (law, typical.shape, typical.diffusion, noise)
        self._limit = limit
        self._rng = rng

    def next_state(self, x: Any, u: Any, dt: float) -> Any:
        """Return the state after some hours, with the noise of the growth in it."""
        if dt > 0.0:
            state = x.matrix
            _grow(state, self._rng.standard_normal((2, state.shape[1])), *self._growth, dt)
        return x

    def output(self, x: Any) -> Any:
        """Return what a test measures."""
        return self.OutputContainer({"x": x["x"]})

    def event_state(self, x: Any) -> dict[str, Any]:
        """Return the share of the way that is left."""
        return {"limit": 1.0 - x["x"] / self._limit}

    def threshold_met(self, x: Any) -> dict[str, Any]:
        """Return whether the limit is reached."""
        level = x.matrix[0]
        return {"limit": level[0] >= self._limit if level.size == 1 else level >= self._limit}


@kernel()
def _grow(
    state: NDArray[np.float64],
    noise: NDArray[np.float64],
    law: int,
    shape: float,
    diffusion: float,
    increment_noise: float,
    dt: float,
) -> None:
    """Let faults grow in place: rows of the state as of the model, columns of particles.

    The laws are those of ``ema_core.growth_laws``, one particle at a time: progpy simulates each
    sample by itself, and numpy on single numbers took most of its time.
    """
    # A factor to a test's increment, as that of the shorter or longer step here.
    variance = np.expm1(increment_noise**2) * _INTERVAL_HOURS / dt
    sigma = np.sqrt(np.log1p(variance))
    mean = np.exp(0.5 * increment_noise**2)
    walk = JITTER * np.sqrt(dt / _INTERVAL_HOURS)
    for i in range(state.shape[1]):
        x, rate, waiting = state[0, i], np.exp(state[1, i]), state[2, i]
        active = min(max(dt - waiting, 0.0), dt)
        if law == _DRIFT:
            x += rate * active + diffusion * np.sqrt(active) * noise[0, i]
        else:
            x = max(x, 0.0)
            if law == _EXPONENTIAL:
                step = (x + shape) * np.expm1(rate * active)
            elif law == _ARCHARD:
                step = (1.0 / shape + x) * np.expm1(rate * shape * active)
            elif law == _SELF_HEATING:
                spent = rate * shape * active * np.exp(shape * x)
                step = -np.log1p(-spent) / shape if spent < 1.0 else np.inf
            else:
                step = (x ** (1.0 / shape) + active / rate) ** shape - x
            x += mean * np.exp(sigma * noise[0, i] - 0.5 * sigma**2) * step
        state[0, i] = min(x, 2.0)
        state[1, i] += walk * noise[1, i]
        state[2, i] = max(waiting - dt, 0.0)


def particle_filter(life: SimulatedLife, measurements: Sequence[Measurement]) -> Predictions:
    """Return the predictions of a life."""
    name = life.dominant
    number = FAULT_NAMES.index(name)
    typical = TYPICAL[kind_of(name)]
    side = np.sign(life.faults[-1, number] - healthy_faults()[number])
    rng = np.random.default_rng(1)
    np.random.seed(1)  # noqa: NPY002 - progpy and filterpy draw from the global generator
    model = FaultGrowth(typical, LIMITS[name], rng)
    start = [
        {"x": 0.0, "log_rate": value, "waiting": hours}
        for value, hours in zip(
            np.log(typical.rate) + typical.rate_sigma * rng.standard_normal(PARTICLES),
            typical.latest_onset * rng.random(PARTICLES),
            strict=True,
        )
    ]
    begin = measurements[0].hours - _INTERVAL_HOURS
    noise = {"x": 1.0}
    filtered = ParticleFilter(
        model, UnweightedSamples(start), t0=begin, measurement_noise=noise, dt=_INTERVAL_HOURS
    )
    predictor = MonteCarlo(model)
    # One for all steps: by default progpy makes an empty container at each.
    no_load = model.InputContainer({})
    samples: list[NDArray[np.float64] | None] = []
    seconds: list[float] = []
    typical_life = _HORIZON_HOURS / 4.0
    for measurement in measurements:
        away = side * (measurement.faults[number] - healthy_faults()[number])
        if measurement.unobservable[number] or away == 0.0:
            samples.append(None)
            seconds.append(np.nan)
            continue
        started = time.process_time()
        filtered.parameters["measurement_noise"] = {
            "x": float(np.sqrt(measurement.covariance[number, number]))
        }
        filtered.estimate(measurement.hours, {}, {"x": away})
        # Steps so short that the last one does not show in what is left.
        step = float(np.clip(typical_life / _STEPS, 1.0, 2.0 * _INTERVAL_HOURS))
        result = predictor.predict(
            filtered.x,
            lambda t, x=None: no_load,
            t0=measurement.hours,
            dt=step,
            n_samples=SAMPLES,
            horizon=_HORIZON_HOURS,
            save_freq=2.0 * _HORIZON_HOURS,
        )
        ends = [end for end in result.time_of_event.key("limit") if end is not None]
        left = np.full(SAMPLES, np.inf)
        # An event is noticed at the end of a step: half a step late on average.
        left[: len(ends)] = np.maximum(np.array(ends) - measurement.hours - 0.5 * step, 0.0)
        seconds.append(time.process_time() - started)
        samples.append(left)
        typical_life = float(np.median(np.minimum(left, _HORIZON_HOURS)))
    return Predictions.of(measurements, samples, seconds)
