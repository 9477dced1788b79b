"""Remaining useful life by NASA's progpy: its particle filter and Monte Carlo prediction.

It is told more than our tracker: which component dominates and to which side it goes, its law, and
the hours up to which growth may begin. It looks at that component alone, with its rate and its
onset as further states. Tests in which the component was put back to healthy are kept from it:
taken for a measured zero they made it believe in rates that its particles never came back from.
The rest is as a user would set it up: 1,000 particles, a little jitter on the rate against their
impoverishment, 100 samples a prediction.
"""

import time
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from prognosis_lives import LIMITS
from prognosis_predictors import Predictions
from progpy import PrognosticsModel  # pyright: ignore[reportMissingImports]
from progpy.predictors import MonteCarlo  # pyright: ignore[reportMissingImports]
from progpy.state_estimators import ParticleFilter  # pyright: ignore[reportMissingImports]
from progpy.uncertain_data import UnweightedSamples  # pyright: ignore[reportMissingImports]

from ema_core.faults import FAULT_NAMES, healthy_faults
from ema_core.growth_laws import increment
from ema_core.typical_growth import TYPICAL
from ema_monitor.prognosis.observation import Observation
from ema_sim.lives import Life, LifeSettings

PARTICLES: Final = 1000
SAMPLES: Final = 100
JITTER: Final = 0.01
"""Standard deviation of a random walk of the rate's logarithm [1/sqrt(test)]."""

_RATE_SIGMA: Final = 0.5  # as the tracker's prior
_HORIZON_HOURS: Final = 4000.0
_STEPS: Final = 50
_INTERVAL_HOURS: Final = LifeSettings().interval_hours


class FaultGrowth(PrognosticsModel):
    """One component: distance from healthy, logarithm of the rate, hours left until the onset."""

    inputs: list[str] = []  # noqa: RUF012 - as progpy wants it
    states = ["x", "log_rate", "waiting"]  # noqa: RUF012
    outputs = ["x"]  # noqa: RUF012
    events = ["limit"]  # noqa: RUF012
    is_vectorized = True
    default_parameters = {  # noqa: RUF012
        "law": "linear",
        "shape": 0.0,
        "diffusion": 0.0,
        "limit": 0.5,
        "increment_noise": 0.3,
        "process_noise": 0.0,
        "x0": {"x": 0.0, "log_rate": 0.0, "waiting": 0.0},
    }
    rng = np.random.default_rng(0)

    def next_state(self, x: Any, u: Any, dt: float) -> Any:
        """Return the state after some hours, with the noise of the growth in it."""
        own, level = self.parameters, np.asarray(x["x"], dtype=np.float64)
        size = level.shape
        if dt <= 0.0:
            return x
        active = np.clip(dt - np.asarray(x["waiting"], dtype=np.float64), 0.0, dt)
        rate = np.exp(np.asarray(x["log_rate"], dtype=np.float64))
        if own["law"] == "drift":
            step = rate * active
            step = step + own["diffusion"] * np.sqrt(active) * self.rng.standard_normal(size)
        else:
            # A factor to a test's increment, as that of the shorter or longer step here.
            variance = np.expm1(own["increment_noise"] ** 2) * _INTERVAL_HOURS / dt
            sigma = np.sqrt(np.log1p(variance))
            mean = np.exp(0.5 * own["increment_noise"] ** 2)
            factor = mean * np.exp(sigma * self.rng.standard_normal(size) - 0.5 * sigma**2)
            level = np.maximum(level, 0.0)
            step = factor * increment(own["law"], level, rate, own["shape"], active)
        walk = JITTER * np.sqrt(dt / _INTERVAL_HOURS) * self.rng.standard_normal(size)
        return self.StateContainer(
            {
                "x": np.minimum(level + step, 2.0),
                "log_rate": x["log_rate"] + walk,
                "waiting": np.maximum(np.asarray(x["waiting"]) - dt, 0.0),
            }
        )

    def output(self, x: Any) -> Any:
        """Return what a test tells."""
        return self.OutputContainer({"x": x["x"]})

    def event_state(self, x: Any) -> dict[str, Any]:
        """Return the share of the way that is left."""
        return {"limit": 1.0 - x["x"] / self.parameters["limit"]}

    def threshold_met(self, x: Any) -> dict[str, Any]:
        """Return whether the limit is reached."""
        return {"limit": x["x"] >= self.parameters["limit"]}


def particle_filter(life: Life, observations: Sequence[Observation]) -> Predictions:
    """Return the predictions of a life."""
    name = life.dominant
    number = FAULT_NAMES.index(name)
    kind = "short_circuit" if name.startswith("short_circuit") else name
    typical = TYPICAL[kind]
    side = np.sign(life.faults[-1, number] - healthy_faults()[number])
    rng = FaultGrowth.rng = np.random.default_rng(1)
    np.random.seed(1)  # noqa: NPY002 - progpy and filterpy draw from the global generator
    model = FaultGrowth(
        law=typical.law,
        shape=typical.shape,
        diffusion=typical.diffusion,
        limit=LIMITS[name],
        increment_noise=LifeSettings().process_noise,
    )
    start = [
        {"x": 0.0, "log_rate": value, "waiting": hours}
        for value, hours in zip(
            np.log(typical.rate) + _RATE_SIGMA * rng.standard_normal(PARTICLES),
            typical.latest_onset * rng.random(PARTICLES),
            strict=True,
        )
    ]
    begin = observations[0].hours - _INTERVAL_HOURS
    noise = {"x": 1.0}
    filtered = ParticleFilter(
        model, UnweightedSamples(start), t0=begin, measurement_noise=noise, dt=_INTERVAL_HOURS
    )
    predictor = MonteCarlo(model)
    samples: list[NDArray[np.float64] | None] = []
    seconds: list[float] = []
    typical_life = _HORIZON_HOURS / 4.0
    for observation in observations:
        if observation.at_healthy[number]:
            samples.append(None)
            seconds.append(0.0)
            continue
        started = time.process_time()
        away = side * (observation.faults[number] - healthy_faults()[number])
        filtered.parameters["measurement_noise"] = {
            "x": float(np.sqrt(observation.variance[number]))
        }
        filtered.estimate(observation.hours, {}, {"x": away})
        # Steps so short that the last one does not show in what is left.
        step = float(np.clip(typical_life / _STEPS, 1.0, 2.0 * _INTERVAL_HOURS))
        result = predictor.predict(
            filtered.x,
            t0=observation.hours,
            dt=step,
            n_samples=SAMPLES,
            horizon=_HORIZON_HOURS,
            save_freq=2.0 * _HORIZON_HOURS,
        )
        ends = [end for end in result.time_of_event.key("limit") if end is not None]
        left = np.full(SAMPLES, np.inf)
        # An event is noticed at the end of a step: half a step late on average.
        left[: len(ends)] = np.maximum(np.array(ends) - observation.hours - 0.5 * step, 0.0)
        seconds.append(time.process_time() - started)
        samples.append(left)
        typical_life = float(np.median(np.minimum(left, _HORIZON_HOURS)))
    return Predictions.of(observations, samples, seconds)
