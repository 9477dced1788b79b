# SPDX-License-Identifier: Apache-2.0
"""Identifier, file format and unit check shared by all kinds of calibration."""

import hashlib
import json
import logging
from abc import ABC, abstractmethod
from collections.abc import Iterable
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Final, Self

import numpy as np
import yaml

from ema_core.arrays import Array
from ema_core.description import ActuatorDescription
from ema_core.display import Displayed
from ema_core.expecting import require_type
from ema_core.files import complete_file, open_regular_file
from ema_core.labels import label_of
from ema_core.parameters import ActuatorParameters
from ema_monitor.reasons import Difference, OtherSamples, Reason
from ema_monitor.windows.window import Window

MOST_BYTES: Final = 5_000_000
"""Largest accepted calibration file [bytes]: ten times the largest calibration."""

_HEAD_BYTES: Final = 200
_log = logging.getLogger(__name__)


class StoredCalibration(Displayed, ABC):
    """Base class of calibrations, which are stored in a YAML file with an identifier.

    Each kind of calibration is a frozen dataclass with the attributes below and its own ``FORMAT``.
    Its constructor raises a ``ValueError`` that names the value if a value is impossible.
    """

    FORMAT: ClassVar[int | str]

    actuator_id: str
    serial_number: str
    parameters: ActuatorParameters
    sample_period: float
    not_learned: Any

    @cached_property
    def calibration_id(self) -> str:
        """Identifier of the content: calibrations with equal contents have equal identifiers."""
        # Labels are excluded: they name departures and do not affect estimates.
        text = json.dumps(self._content(with_labels=False), sort_keys=True)
        return f"{self.serial_number}-{hashlib.sha256(text.encode()).hexdigest()[:10]}"

    @property
    def brief(self) -> str:
        """Short string with the identifier and the unit."""
        return f"{self.calibration_id} of {self.actuator_id}"

    @property
    def _remark(self) -> str:
        words = ", ".join(map(label_of, self.not_learned))
        return f"; not learned from these windows: {words}" if words else ""

    def shape_mismatch(self, window: Window) -> Reason | None:
        """Return why the samples of a window do not fit the calibration; None if they fit."""
        if abs(window.sample_period / self.sample_period - 1.0) > 1e-6:
            unit = self.actuator_id, self.serial_number
            return OtherSamples(window.sample_period, self.sample_period, unit)
        return None

    @abstractmethod
    def unit_mismatch(self, description: ActuatorDescription) -> tuple[Difference, ...]:
        """Return the differences between a description and the calibrated unit; empty if none."""

    def _differences(
        self, description: ActuatorDescription, used: Iterable[str]
    ) -> list[Difference]:
        """Return the differences in serial number and used parameters."""
        differences: list[Difference] = []
        if description.serial_number != self.serial_number:
            differences.append(("serial_number", description.serial_number, self.serial_number))
        calibrated, described = self.parameters.as_mapping(), description.parameters.as_mapping()
        return differences + [
            (name, float(described[name]), float(calibrated[name]))
            for name in used
            if not abs(calibrated[name] - described[name]) <= 1e-9 * abs(described[name])
        ]

    def save(self, path: str | Path) -> None:
        """Write the calibration to a YAML file, replacing an existing file atomically.

        Raises
        ------
        ValueError
            If ``path`` has a wrong type.
        OSError
            If the file cannot be written.
        """
        require_type("path", path, (str, Path))
        text = yaml.safe_dump(
            {**self._content(), "calibration_id": self.calibration_id},
            sort_keys=False,
            default_flow_style=None,
            width=96,
        )
        with complete_file(Path(path)) as partial:
            partial.write_text(text, encoding="utf-8")

    @classmethod
    def of_content(cls, path: str | Path, content: Any) -> Self:
        """Return the calibration from the content of a file.

        Logs a warning if the content was edited after it was written.

        Parameters
        ----------
        path
            Path of the file, for messages.
        content
            Parsed content of the file.

        Raises
        ------
        ValueError
            If the content is not a calibration; the message names the file and the defect.
        """
        if not isinstance(content, dict) or content.get("format") != cls.FORMAT:
            raise ValueError(
                f"{path} is not a calibration of format {cls.FORMAT}; "
                "make it again with `ema calibrate`"
            )
        entries = {**content}
        made_as = entries.pop("calibration_id", None)
        del entries["format"]
        try:
            loaded = cls._of_mapping(entries)
            actual_id = loaded.calibration_id
        except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{path} is a damaged calibration: {error}") from error
        # Editing a calibration by hand is permitted.
        if made_as not in (None, actual_id):
            _log.warning(
                "%s was changed after it was written: its calibration_id was %s and is %s now",
                path,
                made_as,
                actual_id,
            )
        return loaded

    def _content(self, *, with_labels: bool = True) -> dict[str, Any]:
        """Return the exact content of the file, without the identifier.

        Labelled states are omitted unless ``with_labels``.
        """
        content = self._as_mapping(with_labels=with_labels)
        if not self.parameters.lead:  # rotary units keep the identifiers of version 0.1
            del content["parameters"]["lead"]
        return content

    @abstractmethod
    def _as_mapping(self, *, with_labels: bool) -> dict[str, Any]:
        """Return the entries of the file; labelled states are omitted unless ``with_labels``."""

    @classmethod
    @abstractmethod
    def _of_mapping(cls, content: dict[str, Any]) -> Self:
        """Return the calibration from the entries of a file; ``content`` may be modified."""


def numbers(name: str, values: Any) -> Array:
    """Return an entry of a file as an array, or raise ValueError if it is not numeric."""
    try:
        return np.array(values, dtype=np.float64)
    except (OverflowError, TypeError, ValueError):
        raise ValueError(f"{name} is not an array of numbers") from None


def is_calibration_file(path: Path) -> bool:
    """Return whether the first lines of a file identify it as a calibration of any kind.

    The result is False if the file cannot be read.
    """
    try:
        with open_regular_file(path) as file:
            head = file.read(_HEAD_BYTES).split(b"\n")
    except (OSError, ValueError):
        return False
    return len(head) > 1 and head[0].startswith(b"format: ") and head[1].startswith(b"actuator_id:")
