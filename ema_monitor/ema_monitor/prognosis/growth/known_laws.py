"""Growth laws that are known, as users write them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from ema_core.faults import COMPONENTS, KINDS, kind_of, settings_by_kind
from ema_core.growth_laws import LAWS, hours_until
from ema_core.quantity import text
from ema_core.wording import unknown_name
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.growth.cells import LIFE_HOURS
from ema_monitor.prognosis.growth.settings import NOMINAL_LAWS, KnownLaw

FORM: Final = "LAW[:RATE[:SHAPE]]"


def _law_of(kind: str) -> Any:
    grows = "each phase's grows" if len(KINDS[kind]) > 1 else "it grows"
    return text("", f"law by which {grows}, {FORM}; empty: unknown")


@dataclass(frozen=True)
class KnownLawTexts(settings_by_kind("_LawByKind", str, _law_of)):
    """Law of each kind of fault, ``LAW[:RATE[:SHAPE]]`` or empty where it is not known.

    Raises
    ------
    ValueError
        When a text is no law; the message begins with the kind of fault.
    """

    def __post_init__(self) -> None:
        self.laws()

    def laws(self) -> Mapping[str, KnownLaw]:
        """Return the law of each component whose law is known."""
        laws = {}
        for name in COMPONENTS:
            kind = kind_of(name)
            written = getattr(self, kind)
            if not isinstance(written, str):
                raise ValueError(f"{kind} = {written!r}: expected a text, {FORM}")
            try:
                if written:
                    laws[name] = known_law(name, written)
            except ValueError as error:
                raise ValueError(f"{kind} = {written!r}: {error}") from error
        return laws


def known_law(fault: str, written: str) -> KnownLaw:
    """Return a law from how users write it.

    Parameters
    ----------
    fault
        Component of the fault vector.
    written
        ``LAW[:RATE[:SHAPE]]``: the law, its median rate a [1/h] (of ``power`` its c [h]) and its
        second figure, x_0, b or p [-], of ``drift`` its s [1/sqrt(h)]; ``linear`` has none.
        Without figures the law must be the one of ``NOMINAL_LAWS``, whose figures are used then.

    Raises
    ------
    ValueError
        When fault or law are unknown, a figure is missing or impossible, or growth at that rate is
        beyond what a tracker follows.
    """
    if fault not in COMPONENTS:
        raise ValueError(unknown_name("fault", fault, COMPONENTS))
    law, *figures = written.split(":")
    if law not in LAWS[1:]:
        raise ValueError(unknown_name(f"law of {fault}", law, LAWS[1:]))
    nominal = NOMINAL_LAWS[fault]
    if not figures:
        if law != nominal.law:
            raise ValueError(
                f"{written!r}: the median rate of {fault} is known for law {nominal.law} only; "
                f"give it as {FORM}"
            )
        return nominal
    try:
        if len(figures) > 2:
            raise ValueError(f"{len(figures)} figures: expected at most two")
        rate, *second = [float(figure) for figure in figures]
        if not second and law != "linear":
            raise ValueError(f"law {law} needs a second figure")
        if law == "drift":
            known = KnownLaw(law, rate, diffusion=second[0])
        else:
            known = KnownLaw(law, rate, shape=second[0] if second else 0.0)
        _check_life(fault, known)
    except ValueError as error:
        raise ValueError(f"law {written!r} of {fault}: {error}; expected {FORM}") from error
    return known


def _check_life(fault: str, known: KnownLaw) -> None:
    limit = HealthLimits().of(fault)
    hours = float(hours_until(known.law, 0.0, known.rate, known.shape, limit))
    if not LIFE_HOURS[0] <= hours <= LIFE_HOURS[-1]:
        raise ValueError(
            f"from healthy to the default limit {limit:g} it takes {hours:.3g} h: expected "
            f"{LIFE_HOURS[0]:.0f} to {LIFE_HOURS[-1]:.0f} h"
        )
