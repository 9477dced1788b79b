"""A defect of a mapping or of its data."""

from dataclasses import dataclass


@dataclass(frozen=True)
class InputDefect:
    """A defect of a mapping or of its data."""

    name: str
    """Stable name, by which a mapping can accept the defect."""

    text: str
    """Description, with values."""

    remedy: str
    """Correction of the mapping, or the next thing to check."""

    is_error: bool = True
    """Whether estimates would be wrong; else some data are lost, or it is a remark."""

    is_certain: bool = True
    """Whether more motion cannot refute the defect; only then live telemetry is withheld."""

    needs_action: bool = True
    """Whether the user should change or check something; else the defect is a remark."""

    def __str__(self) -> str:
        return f"{self.name}: {self.text}: {self.remedy}"
