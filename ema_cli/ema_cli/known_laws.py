"""Growth laws that are known, on the command line."""

from typing import Any, Final

import click

from ema_core.wording import as_identifier
from ema_monitor.prognosis.growth.known_laws import FORM as FORM_OF_LAW
from ema_monitor.prognosis.growth.known_laws import known_law
from ema_monitor.prognosis.growth.settings import KnownLaw

FORM: Final = f"FAULT={FORM_OF_LAW}"


class KnownLawType(click.ParamType):
    """``fault=law``, with the median rate and the second figure of the law where they are known."""

    name = FORM

    def convert(self, value: Any, param: Any, ctx: Any) -> tuple[str, KnownLaw]:
        """Return fault and law."""
        if not isinstance(value, str):
            return value
        fault, _, law = value.partition("=")
        fault = as_identifier(fault)
        try:
            return fault, known_law(fault, law)
        except ValueError as error:
            self.fail(f"{value!r}: {error}", param, ctx)
