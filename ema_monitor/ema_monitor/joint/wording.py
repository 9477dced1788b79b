# SPDX-License-Identifier: Apache-2.0
"""User-facing texts of a comparison: summary, reasons and table rows."""

import math
from collections.abc import Iterable, Sequence
from typing import Final

from ema_core.labels import label_of
from ema_core.wording import text_table
from ema_monitor.joint.baseline import Baseline, Shortcoming
from ema_monitor.joint.comparing import Comparer
from ema_monitor.joint.comparison import Comparison, FigureChange, Judgement, QuantityChange
from ema_monitor.quantities import FRICTION, FRICTION_OVER_INERTIA, INERTIA, QUANTITIES, TORQUE
from ema_monitor.reason_texts import joined
from ema_monitor.reasons import Reason

HEADINGS: Final = ("quantity", "change", "90 % interval", "judgement")
"""Column headings of ``rows``."""

_SHORTCOMINGS: Final = {
    Shortcoming.NO_DATES: (
        "healthy records have no date, and count as records from one day: the change of the joint "
        "between days is assumed; use timestamps with a date"
    ),
    Shortcoming.ONE_DAY: (
        "all healthy records are from one day: the change of the joint between days is assumed; "
        "add healthy records from two more days"
    ),
    Shortcoming.FEW_RECORDS: "there are fewer than 5 healthy records: add healthy records",
    Shortcoming.ONE_SPEED: (
        "the healthy records have nearly one speed, so that Coulomb and viscous friction cannot be "
        "distinguished: add moves at half the speed"
    ),
    Shortcoming.UNEXPLAINED_EFFORT: (
        "the motion does not explain a large part of the effort in the healthy records: check that "
        "effort and position belong to the same joint and have the same clock"
    ),
    Shortcoming.UNCERTAIN_FRICTION: (
        "effort outside the model makes the size of a change of friction uncertain: if the machine "
        "carries parts one way and not back, give the state of its gripper as payload, and move "
        "both ways without a part"
    ),
}

_EFFORT: Final = frozenset({FRICTION, TORQUE})
_WHOLE_PERCENT: Final = 10.0
_LARGE_LAG_S: Final = 0.02
_WHOLE_SIGNED_PERCENT: Final = 100.0


def summary(comparison: Comparison) -> str:
    """Return sentences about changed and not judged quantities, without the final full stop."""
    return ". ".join([finding(comparison), *map(_capital, _not_judged(comparison))])


def finding(comparison: Comparison) -> str:
    """Return sentences about the changed quantities, without the final full stop.

    If nothing has changed and nothing may have changed, the smallest detectable change of friction
    is stated. If no quantity is judged, the reasons are stated.
    """
    if not comparison.judged and not comparison.figures:
        reasons = dict.fromkeys(reason for item in comparison.quantities for reason in item.reasons)
        return "No quantity could be judged" + (f": {joined(reasons)}" if reasons else "")
    departed = [*_changes(comparison), *_figures(comparison.figures)]
    parts = [*departed, *map(_doubt_sentence, comparison.doubtful)]
    if not parts:
        parts = [f"no quantity has changed{_friction_limit(comparison)}"]
    return ". ".join(map(_capital, [*parts, *_state(comparison)]))


def rows(comparison: Comparison) -> list[tuple[str, str, str, str]]:
    """Return one table row per quantity and per changed figure, with the columns ``HEADINGS``."""
    table = [
        (_row_label(item.name), change_text(item), interval_text(item), judgement_text(item))
        for item in comparison.quantities
    ]
    return table + [
        (label_of(item.name), f"× {item.ratio:.3g}", "", "changed") for item in comparison.figures
    ]


def _row_label(name: str) -> str:
    reference = QUANTITIES[name].reference
    return quantity_label(name) + ("" if reference == "healthy" else f" (of {reference})")


def table_text(comparison: Comparison) -> str:
    """Return the table of a comparison as plain text, with headings."""
    return text_table(HEADINGS, rows(comparison))


def why_no_level(comparison: Comparison, warn_limit: float) -> str:
    """Return the reason why a comparison without a departure does not prove a unit healthy.

    The reason is empty if the unit is healthy: friction is judged, its smallest detectable change
    is below the warning limit, and no quantity differs by more than usual variation.

    Parameters
    ----------
    comparison
        Comparison of a record.
    warn_limit
        Relative change of friction at the warning limit [-].
    """
    friction, label = comparison[FRICTION], quantity_label(FRICTION)
    doubts = [_doubt_sentence(item) for item in comparison.doubtful]
    if not friction.is_judged:
        words = f"{label} is not judged: {friction.reason or 'no reason is known'}"
        return "; ".join([words, *doubts])
    if doubts:
        return f"{_joined(doubts, 'and')}, which is beyond usual variation, but not certain"
    if friction.smallest_change < warn_limit:
        return ""
    limit = f"its warning limit is {_plain(warn_limit, friction)} %"
    smallest = smallest_text(friction)
    if not smallest:
        return f"the smallest detectable change of {label} is unknown; {limit}"
    return f"only changes of {label} above {smallest} would show; {limit}"


def quantity_label(name: str) -> str:
    """Return the label of a quantity."""
    quantity = QUANTITIES.get(name)
    return label_of(name) if quantity is None else quantity.label


def change_text(quantity: QuantityChange) -> str:
    """Return the change with sign and unit, such as "+15.2 %"; "" if it is not estimated."""
    if not quantity.is_estimated:
        return ""
    return f"{_signed(quantity.change, quantity)} {unit_of(quantity)}"


def interval_text(quantity: QuantityChange) -> str:
    """Return the 90 % interval with unit, such as "+11.0 to +19.4 %"; "" if it is not estimated."""
    ends = quantity.low, quantity.high
    if not (quantity.is_estimated and all(map(math.isfinite, ends))):
        return ""
    low, high = (_signed(end, quantity) for end in ends)
    return f"{low} to {high} {unit_of(quantity)}"


def smallest_text(quantity: QuantityChange) -> str:
    """Return the smallest detectable change with its unit, such as "6 %"; "" if it is unknown."""
    if not math.isfinite(quantity.smallest_change):
        return ""
    return f"{_plain(quantity.smallest_change, quantity)} {unit_of(quantity)}"


def judgement_text(quantity: QuantityChange) -> str:
    """Return the judgement of a quantity with its reason, rivals or detection limit."""
    if not quantity.is_judged:
        return f"not judged ({quantity.reason})" if quantity.reason else "not judged"
    if quantity.judgement is Judgement.CHANGED:
        if not quantity.rivals:
            return "changed"
        rivals = _joined(map(quantity_label, quantity.rivals), "or")
        return f"changed (not distinguishable from {rivals})"
    smallest = smallest_text(quantity)
    return f"unchanged (changes above {smallest} would show)" if smallest else "unchanged"


def brief(quantity: QuantityChange) -> str:
    """Return a phrase with the label, change and judgement of a quantity."""
    words = change_text(quantity), judgement_text(quantity)
    return f"{quantity_label(quantity.name)} {', '.join(filter(None, words))}"


def improvement_sentences(comparison: Comparison) -> list[str]:
    """Return sentences about healthy records that would lower the smallest detectable changes."""
    sentences = []
    for item in comparison.improvements:
        quantity = comparison[item.name]
        days = f" on {_count(item.days, 'further day')}" if item.days else ""
        sentences.append(
            f"{_count(item.records, 'further healthy record')}{days} would lower the smallest "
            f"detectable change of {quantity_label(item.name)} from "
            f"{_plain(item.present_change, quantity)} {unit_of(quantity)} to "
            f"{_plain(item.smallest_change, quantity)} {unit_of(quantity)} on a day without "
            "healthy records."
        )
    return sentences


def unit_of(quantity: QuantityChange) -> str:
    """Return the unit in which a change is displayed."""
    return "%" if quantity.unit == "-" else quantity.unit


def _changes(comparison: Comparison) -> list[str]:
    """Return sentences about changed quantities, and about rivals of the changed quantities."""
    changed = {item.name: item for item in comparison.changed}
    if FRICTION in changed or INERTIA in changed:
        # The ratio adds no information.
        changed.pop(FRICTION_OVER_INERTIA, None)
    sentences, described = [], set[str]()
    for item in changed.values():
        alike = [name for name, rival in changed.items() if rival.rivals == item.rivals]
        group = (*alike, *item.rivals)
        if item.rivals and _EFFORT.issuperset(group):
            sentences += [] if item.name in described else [_effort_sentence(item)]
        else:
            sentences.append(_change_sentence(item))
        if item.rivals and item.name not in described:
            sentences.append(_rivalry_sentence(alike, item.rivals))
            described.update(group)
    return sentences


def _rivalry_sentence(named: Sequence[str], rivals: Sequence[str]) -> str:
    labels, rival_labels = map(quantity_label, named), map(quantity_label, rivals)
    if len(named) == 1:
        return f"{_joined([*labels, *rival_labels], 'and')} cannot be distinguished in this motion"
    pair = f"{_joined(labels, 'and')} cannot be distinguished from {_joined(rival_labels, 'or')}"
    return f"{pair} in this motion"


def _change_sentence(item: QuantityChange) -> str:
    label = quantity_label(item.name)
    if item.unit == "-":
        quantity = QUANTITIES[item.name]
        share = "" if quantity.reference == "healthy" else f" of {quantity.reference}"
        return f"{label} {_moved(item.change, item.low, item.high, share)}"
    interval = interval_text(item)
    within = f" (90 % interval {interval})" if interval else ""
    return f"{label} changed by {change_text(item)}{within}"


def _doubt_sentence(item: QuantityChange) -> str:
    return f"{quantity_label(item.name)} may have changed by {change_text(item)}"


def _effort_sentence(item: QuantityChange) -> str:
    """Return a sentence about the effort, which rises with friction and falls with the torque.

    It is used if friction and torque per ampere cannot be distinguished.
    """
    figures = item.change, item.low, item.high
    if item.name == TORQUE:
        change, high, low = (1.0 / (1.0 + figure) - 1.0 for figure in figures)
        figures = change, low, high
    return f"effort at the same motion {_moved(*figures)}"


def _moved(change: float, low: float, high: float, share: str = "") -> str:
    verb, sign = ("rose", 1.0) if change >= 0.0 else ("fell", -1.0)
    words = f"{verb} {'by ' * bool(share)}{_decimals(100.0 * sign * change)} %{share}"
    if not (math.isfinite(low) and math.isfinite(high)):
        return words
    ends = sorted(100.0 * sign * end for end in (low, high))
    return f"{words} (90 % interval {_decimals(ends[0])} to {_decimals(ends[1])} %)"


def _figures(figures: Sequence[FigureChange]) -> list[str]:
    """Return one sentence about all changed figures; empty if no figure changed."""
    if not figures:
        return []
    ratios = [f"{label_of(item.name)} {item.ratio:.3g} times" for item in figures]
    first, *rest = ratios
    first = first.replace(label_of(figures[0].name), f"{label_of(figures[0].name)} is", 1)
    return [f"{_joined([first, *rest], 'and')} the healthy value"]


def _state(comparison: Comparison) -> list[str]:
    if not comparison.states:
        return []
    name, share = max(comparison.states.items(), key=lambda state: state[1])
    return [f"the most probable labelled state is {name} ({100.0 * share:.0f} %)"]


def _friction_limit(comparison: Comparison) -> str:
    smallest = smallest_text(comparison[FRICTION])
    if not comparison[FRICTION].is_judged or not smallest:
        return ""
    return f": changes of {quantity_label(FRICTION)} above {smallest} would show"


def _not_judged(comparison: Comparison) -> list[str]:
    """Return a list with one phrase about the quantities that are not judged, grouped by reason.

    Rivals of a changed quantity are omitted. The list is empty if there are no such quantities, or
    no quantity is judged.
    """
    by_reason: dict[tuple[Reason, ...], list[str]] = {}
    for item in comparison.quantities:
        if not item.is_judged and not item.rivals:
            by_reason.setdefault(item.reasons, []).append(quantity_label(item.name))
    if not by_reason or not comparison.judged:
        return []
    groups = [(joined(reasons), _joined(labels, "and")) for reasons, labels in by_reason.items()]
    texts = [f"{labels} ({reason})" if reason else labels for reason, labels in groups]
    return [f"not judged: {', '.join(texts)}"]


def _capital(sentence: str) -> str:
    return f"{sentence[:1].upper()}{sentence[1:]}"


def _signed(value: float, quantity: QuantityChange) -> str:
    if quantity.unit == "-":
        text = _decimals(100.0 * value)
    else:
        smallest = quantity.smallest_change
        is_positive = math.isfinite(smallest) and smallest > 0.0
        # Two digits of the smallest change.
        decimals = max(0, 1 - math.floor(math.log10(smallest))) if is_positive else 3
        text = f"{value:z.{decimals}f}"
    return text if text.startswith("-") else f"+{text}"


def _decimals(percent: float) -> str:
    return f"{percent:z.{0 if abs(percent) >= _WHOLE_SIGNED_PERCENT else 1}f}"


def _plain(value: float, quantity: QuantityChange) -> str:
    if quantity.unit != "-":
        return f"{value:.2g}"
    percent = 100.0 * value
    return f"{percent:.2g}" if percent < _WHOLE_PERCENT else f"{percent:.0f}"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")


def _joined(words: Iterable[str], conjunction: str) -> str:
    *first, last = words
    return f"{', '.join(first)} {conjunction} {last}" if first else last


def baseline_sentences(comparer: Comparer) -> list[str]:
    """Return sentences about the detection limits of a baseline and how to lower them."""
    another_day, same_day = (
        _percent(smallest[FRICTION])
        for smallest in (comparer.smallest_changes, comparer.smallest_changes_of_a_day)
    )
    where = f"above {another_day} would show"
    if Shortcoming.NO_DATES not in comparer.baseline.shortcomings:
        where = (
            f"above {same_day} would show on a day that has healthy records, above {another_day} "
            "on another day"
        )
    return [f"{quantity_label(FRICTION)}: changes {where}", *advice_sentences(comparer)]


def advice_sentences(comparer: Comparer) -> list[str]:
    """Return sentences of advice on how to lower the detection limits of a baseline."""
    sentences = []
    for item in comparer.improvements:
        days = f" on {_count(item.days, 'further day')}" if item.days else ""
        sentences.append(
            f"{_count(item.records, 'further healthy record')}{days} would lower the limit on "
            f"another day to {_percent(item.smallest_change)}"
        )
    sentences += [_SHORTCOMINGS[item] for item in comparer.baseline.shortcomings]
    return sentences + _lag_sentences(comparer.baseline.preparation.unexpected_lag_s)


def friction_advice(baseline: Baseline) -> str:
    """Return the advice for an uncertain size of changes of friction; "" if it is certain."""
    shortcoming = Shortcoming.UNCERTAIN_FRICTION
    return _SHORTCOMINGS[shortcoming] if shortcoming in baseline.shortcomings else ""


def _lag_sentences(lag_s: float) -> list[str]:
    """Return a list with a remark on a lag of the effort that its acquisition does not explain.

    The list is empty if the lag is below 20 ms.
    """
    if abs(lag_s) < _LARGE_LAG_S:
        return []
    relation = "later" if lag_s > 0.0 else "earlier"
    return [
        f"the effort is {1e3 * abs(lag_s):.0f} ms {relation} than the motion and the described "
        "acquisition explain; the lag is corrected: check filters and clocks of effort and position"
    ]


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %" if share < _WHOLE_PERCENT / 100.0 else f"{100.0 * share:.0f} %"
