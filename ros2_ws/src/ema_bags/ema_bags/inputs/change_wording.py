# SPDX-License-Identifier: Apache-2.0
"""Wording of suggested mapping changes."""

from typing import Any

from ema_bags.inputs.factors import MappingChange, MeasuredRelations


def change_remedy(change: MappingChange) -> str:
    """Return the corrected mapping entry as YAML text."""
    return f"{change.quantity}: {{{change.entry}: {_words(change.value)}}}"


def change_reason(change: MappingChange) -> str:
    """Return a clause on the probable mistake in the mapping and its evidence."""
    return (
        f"{change.quantity} has {change.entry} {_words(change.stated)}, but is probably "
        f"{_words(change.value)} ({', '.join(_facts(change.relations))})"
    )


def _facts(relations: MeasuredRelations) -> list[str]:
    facts = []
    if relations.gain is not None:
        facts.append(f"the position moves {relations.gain:.4g} times as far as the command")
    if relations.speed_ratio is not None:
        facts.append(
            f"its derivative is {relations.speed_ratio:.4g} times the speed times the gear ratio"
        )
    if relations.end_stop is not None:
        facts.append(
            f"the position reaches {relations.reach:.4g} rad, but the end stop is at "
            f"{relations.end_stop:g} rad"
        )
    return facts


def _words(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
