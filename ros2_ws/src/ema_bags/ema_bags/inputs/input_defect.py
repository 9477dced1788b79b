"""A defect of a mapping or of its data."""

from dataclasses import dataclass


@dataclass(frozen=True)
class InputDefect:
    """Something wrong.

    Attributes
    ----------
    name
        Its stable name, by which a mapping can accept it.
    text
        What is wrong, with values.
    remedy
        What to write in the mapping, or where else to look.
    is_error
        Whether estimates would be wrong; else it costs some data, or is worth knowing.
    is_certain
        Whether more motion cannot refute it: only then live telemetry is withheld.
    needs_action
        Whether the user should change or check something; else it is worth knowing only.
    """

    name: str
    text: str
    remedy: str
    is_error: bool = True
    is_certain: bool = True
    needs_action: bool = True

    def __str__(self) -> str:
        return f"{self.name}: {self.text}: {self.remedy}"
