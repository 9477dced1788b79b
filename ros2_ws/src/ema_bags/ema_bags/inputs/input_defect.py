# SPDX-License-Identifier: Apache-2.0
"""A defect of a mapping or of its data."""

from dataclasses import dataclass

from ema_bags.inputs.defect_kinds import DefectKind


@dataclass(frozen=True)
class InputDefect:
    """A defect of a mapping or of its data."""

    kind: DefectKind
    """Kind, listed in the mapping's ``accept`` to accept the defect."""

    text: str
    """Description of the defect, including the measured values."""

    remedy: str
    """Correction of the mapping, or the next thing to check."""

    is_error: bool = True
    """Whether the defect makes estimates wrong. Otherwise it only costs data or is informative."""

    is_certain: bool = True
    """Whether the defect is proven.

    Live telemetry is withheld only for proven defects; more motion may refute the others.
    """

    needs_action: bool = True
    """Whether the user should change or check something. Otherwise the defect is informative."""

    def __str__(self) -> str:
        return f"{self.kind}: {self.text}: {self.remedy}"
