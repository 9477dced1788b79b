"""Which software a result follows from: a digest of the sources that it depends on."""

from functools import cache
from typing import Final

from ema_core.source_digest import source_digest

_ESTIMATION: Final = (
    "ema_core",
    "ema_monitor.calibration",
    "ema_monitor.identification",
    "ema_monitor.model",
    "ema_monitor.optimizers",
    "ema_monitor.current_balance",
    "ema_monitor.windows",
    "ema_bags",
    "ema_ros",
    "ema_archive.bag_task",
    "ema_archive.calibrations",
    "ema_archive.tables",
)
_PROGNOSIS: Final = (
    "ema_core",
    "ema_monitor.calibration",
    "ema_monitor.health",
    "ema_monitor.identification.estimate",
    "ema_monitor.model",
    "ema_monitor.prognosis",
    "ema_archive.calibrations",
    "ema_archive.resuming",
    "ema_archive.service_record",
    "ema_archive.tables",
    "ema_archive.unit_task",
)


@cache
def estimation_software() -> str:
    """Return a digest of all sources that the estimates of a bag depend on."""
    return source_digest(_ESTIMATION)


@cache
def prognosis_software() -> str:
    """Return a digest of all sources that health and life depend on, beside the estimates."""
    return source_digest(_PROGNOSIS)
