"""Which calibration a bag of an archive is identified with."""

from functools import lru_cache
from urllib.parse import quote

from ema_archive.sources import local_copy, mark_of, time_of
from ema_core.description import UnitKey
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibrations import AnyCalibration, load_calibration


def calibration_of(source: str, unit: UnitKey) -> AnyCalibration | str:
    """Return the calibration of a unit, or why there is none.

    Parameters
    ----------
    source
        The pattern of the archive's settings, or else the calibration beside the bag; empty for the
        shipped one. ``{actuator_id}`` and ``{serial_number}`` stand for those of the unit.

    Raises
    ------
    OSError
        When a file that is there cannot be read.
    """
    if not source:
        return Calibration.builtin()
    url = _url(source, unit)
    mark = mark_of(url)
    return _loaded(url, mark) if mark else f"there is no calibration: {url} is missing"


def changed_ns(source: str, unit: UnitKey) -> int | None:
    """Return when the calibration of a unit was changed [ns]; arguments as of `calibration_of`.

    None for the shipped one, one that is missing, and where the store does not tell.
    """
    return time_of(_url(source, unit)) if source else None


def identity_of(calibration: AnyCalibration | str) -> str:
    """Return the identity of a calibration; empty when there is none."""
    return "" if isinstance(calibration, str) else calibration.calibration_id


def _url(source: str, unit: UnitKey) -> str:
    for name, value in zip(("actuator_id", "serial_number"), unit, strict=True):
        source = source.replace(f"{{{name}}}", quote(value, safe=" "))
    return source


@lru_cache(256)
def _loaded(url: str, mark: str) -> AnyCalibration | str:
    with local_copy(url) as path:
        try:
            return load_calibration(path)
        except ValueError as error:
            return f"the calibration cannot be used: {str(error).replace(str(path), url)}"
