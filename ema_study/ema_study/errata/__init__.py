"""The thesis's slips, each with what shows it."""

from functools import cache

from ema_study.errata.equations import equation_errata
from ema_study.errata.erratum import Erratum
from ema_study.errata.figures import figure_errata
from ema_study.errata.printed_means import printed_means_that_differ
from ema_study.errata.procedure import procedure_errata

__all__ = ["Erratum", "errata", "printed_means_that_differ"]


@cache
def _all() -> tuple[Erratum, ...]:
    return (*equation_errata(), *procedure_errata(), *figure_errata())


def errata() -> list[Erratum]:
    """Return the slips: equations, then algorithms and their code, then tables and text.

    Notes
    -----
    Computed from the thesis's runs and from the models, in some seconds the first time.
    """
    return list(_all())
