"""A slip of the thesis."""

from typing import NamedTuple


class Erratum(NamedTuple):
    """A slip, and what shows that it is one.

    Attributes
    ----------
    where
        Equation, table, section or appendix of the thesis.
    printed
        What it has, in our words.
    found
        What holds instead.
    evidence
        Argument, or figures computed from the thesis's runs and from the models.
    """

    where: str
    printed: str
    found: str
    evidence: str
