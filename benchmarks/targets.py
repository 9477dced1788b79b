"""The targets of accuracy and what was measured of them, as rows of a table."""

from collections.abc import Iterable
from typing import Any, Final, NamedTuple

import numpy as np
import thesis

FLOOR_PERCENT: Final = 0.2
"""Error below which half of the thesis's best need not be reached [%]."""

MULTIPLE_PERCENT: Final = 0.3
"""Largest error that the multiple fault may have [%]."""

MOST_ALARMS: Final = 0.01
"""Share of healthy windows in which the test for small faults may raise an alarm [-]."""

SINGLE: Final = ("friction", "backlash", "short circuit", "eccentricity", "gain")
"""The thesis's single faults, each low and high."""


class Row(NamedTuple):
    """A row of the table; ``met`` is None where no target is set."""

    what: str
    target: str
    measured: str
    met: bool | None
    thesis: str = ""


def at_most(what: str, value: float, limit: float, measured: str = "", published: str = "") -> Row:
    """Return the row of a value that is to be at most so large."""
    return Row(what, f"<= {limit:g}", measured or f"{value:.2f}", bool(value <= limit), published)


def at_least(what: str, value: float, limit: float, measured: str = "") -> Row:
    """Return the row of a value that is to be at least so large."""
    return Row(what, f">= {limit:g}", measured or f"{value:.2f}", bool(value >= limit))


def all_of(what: str, met: Iterable[bool], worst: str = "") -> Row:
    """Return the row of conditions that are all to be met, with the worst in words."""
    flags = list(met)
    measured = f"{sum(flags)}; {worst}" if worst else str(sum(flags))
    return Row(what, str(len(flags)), measured, len(flags) > 0 and all(flags))


def untargeted(what: str, measured: str) -> Row:
    """Return the row of a figure without a target."""
    return Row(what, "", measured, None)


def rows(figures: dict[str, Any]) -> list[Row]:
    """Return the rows for the figures of a run."""
    return [
        *_thesis_rows(figures),
        *_random_rows(figures["errors"]),
        *_time_rows(figures),
        *_covariance_rows(figures["covariance"]),
        *_detection_rows(figures["detection"]),
    ]


def case_target_percent(by_algorithm: dict[str, thesis.Result]) -> float:
    """Return the largest error that a single fault may have [%]."""
    return max(thesis.best_percent(by_algorithm) / 2.0, FLOOR_PERCENT)


def _thesis_rows(figures: dict[str, Any]) -> list[Row]:
    published = thesis.results()
    result = []
    for kind, label in (("thesis", ""), ("first", ", first cycle")):
        errors = {name: one[kind] for name, one in figures["thesis_cases"].items()}
        for level, limit, best in (
            ("low", 0.25, thesis.MEAN_LOW_PERCENT),
            ("high", 0.5, thesis.MEAN_HIGH_PERCENT),
        ):
            mean = float(np.mean([errors[f"{fault} {level}"] for fault in SINGLE]))
            result.append(
                at_most(
                    f"single faults {level}, mean{label} [%]", mean, limit, published=f"{best:.2f}"
                )
            )
        shares = {
            name: error / case_target_percent(published[name])
            for name, error in errors.items()
            if name != "multiple"
        }
        worst = max(shares, key=lambda name: shares[name])
        result.append(
            Row(
                f"each single fault{label} [%]",
                "<= half, 0.2",
                f"{sum(share <= 1.0 for share in shares.values())} of {len(shares)}; "
                f"{worst} {errors[worst]:.2f}",
                shares[worst] <= 1.0,
                f"{thesis.best_percent(published[worst]):.2f}",
            )
        )
        best = thesis.best_percent(published["multiple"])
        result.append(
            at_most(
                f"multiple fault{label} [%]",
                errors["multiple"],
                MULTIPLE_PERCENT,
                published=f"{best:.2f}",
            )
        )
    return result


def _random_rows(errors: dict[str, Any]) -> list[Row]:
    clean, noisy, plants, play = (errors[name] for name in ("random", "noisy", "plants", "play"))
    count = clean["cases"]
    return [
        at_most(f"{count} random faults, median [%]", clean["median"], 0.5),
        at_most("  90th percentile [%]", clean["p90"], 1.2),
        at_most("  largest [%]", clean["max"], 5.0),
        at_most("the same with noisy sensors, median [%]", noisy["median"], 0.8),
        _tail(noisy),
        at_most("the same, noisy, plant 5 % off, median [%]", plants["median"], 1.5),
        _tail(plants),
        untargeted(
            f"{play['cases']} wide, noisy, unknown play, median [%]", f"{play['median']:.2f}"
        ),
        _tail(play),
    ]


def _tail(errors: dict[str, float]) -> Row:
    return untargeted("  90th percentile, largest [%]", f"{errors['p90']:.2f}, {errors['max']:.2f}")


def _time_rows(figures: dict[str, Any]) -> list[Row]:
    timing = figures["timing"]
    studies = f"{thesis.FASTEST_TIME_S:.0f} to {thesis.LONGEST_TIME_S:.0f} s"
    result = []
    for name, label, limit, published in (
        ("cold", "cold estimate", 0.25, studies),
        ("warm", "warm estimate", 0.05, ""),
        ("swarm", "particle swarm, 200 x 50", 1.0, f"{thesis.SWARM_TIME_S:.0f} s"),
    ):
        one = timing[name]
        seconds, units = (
            f"{one[f'{what}_median']:.{digits}f} ({one[f'{what}_p95']:.{digits}f})"
            for what, digits in (("seconds", 3), ("yardstick_windows", 0))
        )
        what = f"{label}, median (95 %) [s]"
        result += [
            at_most(what, one["seconds_median"], limit, seconds, published),
            untargeted("  in yardstick windows", units),
        ]
    evaluations = figures["errors"]["random"]["evaluations_median"]
    result.insert(
        2, at_most("  evaluations, median", evaluations, 300, f"{evaluations:.0f}", "10,000")
    )
    return result


def _covariance_rows(covariance: dict[str, Any]) -> list[Row]:
    share, ratio = covariance["coverage"], covariance["width_over_bound"]
    return [
        Row(
            "90 % interval covers, wide noisy [%]",
            "85 to 95",
            f"{100.0 * share:.1f}",
            0.85 <= share <= 0.95,
        ),
        at_most("  its median width over the bound's", ratio, 3.0),
    ]


def _detection_rows(detection: dict[str, Any]) -> list[Row]:
    alarms = detection["warnings"] + detection["errors"] + detection["not_valid"]
    result = [
        Row(
            f"false alarms in {detection['windows']} healthy noisy windows",
            "0",
            f"{detection['warnings']} WARN, {detection['errors']} ERROR, "
            f"{detection['not_valid']} invalid",
            alarms == 0,
        ),
    ]
    # The most sensitive test that keeps to the alarms is judged; stricter ones are for comparison.
    judged = min(test["z"] for test in detection["tests"].values())
    for test in detection["tests"].values():
        compared = test["z"] > judged
        smallest = test["smallest_percent"]
        worst = max(smallest, key=lambda name: smallest[name])
        result += [
            Row(
                f"  windows with a fault beyond {test['z']:.2f} sigma",
                f"<= {100.0 * MOST_ALARMS:g} %",
                f"{test['alarms']} (largest {detection['largest_deviation_sigma']:.2f})",
                test["alarms"] <= MOST_ALARMS * detection["windows"],
            ),
            Row(
                "  smallest fault so detected, power 90 % [%]",
                "" if compared else "<= 1 for each",
                f"{smallest[worst]:g} ({worst.replace('_', ' ')})",
                None if compared else smallest[worst] <= 1.0,
            ),
        ]
    return result
