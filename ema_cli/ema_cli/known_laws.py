"""Growth laws that are known, on the command line."""

from typing import Any, Final

import click

from ema_core.growth_laws import LAWS
from ema_monitor.prognosis.settings import COMPONENTS, NOMINAL_LAWS, KnownLaw

FORM: Final = "FAULT=LAW[:RATE[:SHAPE]]"


class KnownLawType(click.ParamType):
    """``fault=law``, with the median rate and the second figure of the law where they are known.

    Without figures the law must be the one that ``NOMINAL_LAWS`` has for that fault. The second
    figure is x_0, b or p, and s for ``drift``.
    """

    name = FORM

    def convert(self, value: Any, param: Any, ctx: Any) -> tuple[str, KnownLaw]:
        """Return fault and law."""
        if not isinstance(value, str):
            return value
        fault, _, rest = value.partition("=")
        law, *figures = rest.split(":")
        if fault not in COMPONENTS:
            self.fail(f"unknown fault {fault!r}; known: {', '.join(COMPONENTS)}", param, ctx)
        if law not in LAWS[1:]:
            self.fail(f"unknown law {law!r} of {fault}; known: {', '.join(LAWS[1:])}", param, ctx)
        nominal = NOMINAL_LAWS[fault]
        if not figures:
            if law != nominal.law:
                self.fail(
                    f"{value!r}: the median rate of {fault} is known for law {nominal.law} only; "
                    f"give it as {FORM}",
                    param,
                    ctx,
                )
            return fault, nominal
        try:
            rate, second = [float(figure) for figure in [*figures, "nan"][:2]]
            if len(figures) > 2:
                raise ValueError(f"{len(figures)} figures: expected at most two")
            return fault, _law(law, rate, second, has_second=len(figures) == 2)
        except ValueError as error:
            self.fail(f"{value!r}: {error}; expected {FORM}", param, ctx)


def _law(law: str, rate: float, second: float, *, has_second: bool) -> KnownLaw:
    if not has_second:
        return KnownLaw(law, rate)
    if law == "drift":
        return KnownLaw(law, rate, diffusion=second)
    return KnownLaw(law, rate, shape=second)
