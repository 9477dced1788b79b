"""Identity of a calibration, and its file, which carries that identity."""

import hashlib
import json
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import yaml

from ema_core.files import complete_file, open_regular_file

_HEAD_BYTES: Final = 200
_log = logging.getLogger(__name__)


def identity_of(serial_number: str, content: Mapping[str, Any]) -> str:
    """Return the identity of what a calibration holds: equal figures have an equal one."""
    text = json.dumps(content, sort_keys=True)
    return f"{serial_number}-{hashlib.sha256(text.encode()).hexdigest()[:10]}"


def write_calibration(path: Path, content: Mapping[str, Any], calibration_id: str) -> None:
    """Write a calibration to a YAML file; an existing one is replaced once it is complete."""
    text = yaml.safe_dump(
        {**content, "calibration_id": calibration_id},
        sort_keys=False,
        default_flow_style=None,
        width=96,
    )
    with complete_file(path) as partial:
        partial.write_text(text)


def log_if_changed(path: Path, made_as: str | None, calibration_id: str) -> None:
    """Log that a calibration is not what was written to its file, which is permitted.

    Parameters
    ----------
    path
        The file.
    made_as
        Identity that the file names; None in files that were written without one.
    calibration_id
        Identity of its content.
    """
    if made_as not in (None, calibration_id):
        _log.warning(
            "%s was changed after it was written: it was calibration %s and is %s now",
            path,
            made_as,
            calibration_id,
        )


def is_calibration_file(path: Path) -> bool:
    """Return whether a file begins as the file of a calibration does, of either kind."""
    try:
        with open_regular_file(path) as file:
            head = file.read(_HEAD_BYTES).split(b"\n")
    except (OSError, ValueError):
        return False
    return len(head) > 1 and head[0].startswith(b"format: ") and head[1].startswith(b"actuator_id:")
