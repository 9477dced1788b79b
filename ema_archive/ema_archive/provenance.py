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
    "ema_monitor.unknown_drive",
    "ema_monitor.windows",
    "ema_recording.chunk_index",
    "ema_recording.contents",
    "ema_recording.gaps",
    "ema_recording.message_type",
    "ema_recording.metadata",
    "ema_recording.packed",
    "ema_recording.reader",
    "ema_recording.records",
    "ema_recording.schema",
    "ema_recording.telemetry",
    "ema_recording.usage",
    "ema_recording.windows",
    "ema_ros.description",
    "ema_ros.faults",
    "ema_ros.measured",
    "ema_ros.stamps",
    "ema_ros.telemetry",
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
