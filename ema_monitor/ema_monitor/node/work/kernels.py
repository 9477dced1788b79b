# SPDX-License-Identifier: Apache-2.0
"""Compilation of the monitor's kernels before it receives windows."""

import threading
import time
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

import numpy as np

from ema_core.faults import N_FAULTS, healthy_faults
from ema_monitor.model.monitor_model import FORMS, compile_kernels
from ema_monitor.prognosis.duty.meter import count_travel
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.growth.tracker import Tracker

_FOLLOWED: Final = 3
_REPORT_PERIOD_S: Final = 1.0


def _compile_growth() -> None:
    """Compile the growth kernels by tracking a healthy actuator over a few tests."""
    tracker = Tracker()
    covariance, is_hidden = 1e-6 * np.eye(N_FAULTS), np.zeros(N_FAULTS, dtype=bool)
    for number in range(_FOLLOWED):
        tracker.update(Measurement(10.0 * number, healthy_faults(), covariance, is_hidden))
    tracker.predict()


STEPS: Final[Mapping[str, Callable[[], object]]] = MappingProxyType(
    {f"{form} model": lambda form=form: compile_kernels([form]) for form in FORMS}
    | {
        "growth": _compile_growth,
        "duty": lambda: count_travel(
            np.arange(2.0), np.ones(2), 1.0, 0.0, np.zeros(1), np.zeros(1)
        ),
    }
)
"""Compilation steps required for estimates and health, by name; each may use the cache."""


def compile_monitor_kernels(
    is_ending: Callable[[], bool], report_progress: Callable[[str], None]
) -> None:
    """Compile the kernels or load them from the cache; return when all kernels are ready.

    They are compiled in a separate thread, which cannot be interrupted: if the node shuts down, the
    thread is abandoned.

    Parameters
    ----------
    is_ending
        Returns whether the node is shutting down.
    report_progress
        Called once a second with a description of the current step.

    Raises
    ------
    ValueError
        If a kernel cannot be compiled, or the node shuts down.
    """
    reported_s = start_s = time.monotonic()
    failures: list[BaseException] = []
    for number, (name, step) in enumerate(STEPS.items(), 1):
        text = f"{name}, {number} of {len(STEPS)}"

        def compile_it(step: Callable[[], object] = step) -> None:
            try:
                step()
            except BaseException as error:
                failures.append(error)

        thread = threading.Thread(target=compile_it, name="compilation", daemon=True)
        thread.start()
        while thread.is_alive():
            thread.join(0.1)
            now_s = time.monotonic()
            if is_ending():
                raise ValueError("the node was shut down while its kernels were compiled")
            if now_s - reported_s >= _REPORT_PERIOD_S:
                elapsed = f"{now_s - start_s:.0f} s"
                report_progress(f"compiling kernels, once for this version: {text}, {elapsed}")
                reported_s = now_s
        if failures:
            raise ValueError(f"kernels cannot be compiled: {text}: {failures[0]!r}")
