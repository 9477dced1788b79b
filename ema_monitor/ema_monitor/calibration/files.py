"""Identity of a calibration, and its file, which carries that identity."""

import hashlib
import json
import logging
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, TypeVar

import yaml

from ema_core.files import complete_file, open_regular_file

_HEAD_BYTES: Final = 200
_OF_THE_FILE: Final = ("format", "calibration_id")
_Built = TypeVar("_Built")
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


def built_of(
    path: Path, content: Mapping[str, Any], build: Callable[[dict[str, Any]], _Built]
) -> _Built:
    """Return the calibration of a file; log where that is not what was written to it.

    Parameters
    ----------
    path
        The file, for the messages.
    content
        What it holds, in plain values.
    build
        Makes the calibration, with its ``calibration_id``, of the entries that are its own, which
        it may change.

    Raises
    ------
    ValueError
        When they are none; the message names the file.
    """
    entries = {name: value for name, value in content.items() if name not in _OF_THE_FILE}
    try:
        loaded: Any = build(entries)
    except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path} is a damaged calibration: {error}") from error
    made_as = content.get("calibration_id")
    # A change by hand is permitted; files of earlier versions have no identity.
    if made_as not in (None, loaded.calibration_id):
        _log.warning(
            "%s was changed after it was written: it was calibration %s and is %s now",
            path,
            made_as,
            loaded.calibration_id,
        )
    return loaded


def is_calibration_file(path: Path) -> bool:
    """Return whether a file begins as the file of a calibration does, of either kind."""
    try:
        with open_regular_file(path) as file:
            head = file.read(_HEAD_BYTES).split(b"\n")
    except (OSError, ValueError):
        return False
    return len(head) > 1 and head[0].startswith(b"format: ") and head[1].startswith(b"actuator_id:")
