"""Every mean and deviation that the thesis prints, checked against its own runs."""

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import pandas as pd

from ema_study.averages import fault_means_of, overview_of, with_margins
from ema_study.cases import SINGLE_FAULTS
from ema_study.plan import ALGORITHMS
from ema_study.printed_runs import printed_runs
from ema_study.printed_tables import (
    MEAN,
    OVERVIEWS,
    SIGMA,
    SUM,
    SUMMARIES,
    TOTAL,
    fault_means,
    multiple_deviations,
    overview,
    reliability_multiple,
    reliability_single,
    run_means,
)
from ema_study.reliability import (
    PRECISION_STUDY,
    SPEED_STUDY,
    multiple_fault_reliability,
    reliability_of_overviews,
)

# Half a digit of a run's figure: what the mean over runs may be off by [%, s].
_HALF_OF_RUN = {"error_percent": 0.005, "time_s": 0.5}
# Half a digit of a mean beside the runs and in the summaries; of the overviews.
_HALF_OF_MEAN = {"error_percent": 0.005, "time_s": 0.5}
_HALF_OF_OVERVIEW = {"error_percent": 0.0005, "time_s": 0.5}
_HALF_OF_RC = 0.005
_UNITS = {"error_percent": "%", "time_s": "s"}
_NOUNS = {"error_percent": "mean error", "time_s": "mean time"}
# A sample's deviation moves by at most sqrt(n / (n - 1)) times what its members move by.
_FIVE_MEMBERS, _TEN_MEMBERS = (5 / 4) ** 0.5, (10 / 9) ** 0.5


class Comparison(NamedTuple):
    """A printed figure and what its runs give.

    Attributes
    ----------
    table
        Number of the table.
    cell
        Which figure of it.
    unit
        Its unit.
    printed, recomputed
        The figures.
    rounding
        How far they may be apart by rounding of the runs and of the printed figure.
    """

    table: int
    cell: str
    unit: str
    printed: float
    recomputed: float
    rounding: float

    @property
    def differs(self) -> bool:
        """Whether they differ by more than rounding."""
        return abs(self.printed - self.recomputed) > self.rounding * (1.0 + 1e-9)


class WrongMean(NamedTuple):
    """A mean of table 58 or 59 that is not that of its runs, which ``table_of_runs`` lists."""

    table: int
    algorithm: str
    level: str
    fault: str
    printed: float
    recomputed: float
    table_of_runs: int

    @property
    def cell(self) -> str:
        """Which mean it is, in words."""
        return f"{self.algorithm.upper()}, {self.fault.replace('_', ' ')} {self.level}"

    @property
    def unit(self) -> str:
        """Its unit."""
        return _UNITS[OVERVIEWS[self.table]]


def comparisons(overviews: Mapping[int, pd.DataFrame] | None = None) -> Iterator[Comparison]:
    """Yield every printed mean, deviation, product and coefficient beside what its runs give.

    Parameters
    ----------
    overviews
        What tables 58 and 59 are taken to be, by number; by default what the runs give.
    """
    runs = printed_runs()
    if overviews is None:
        overviews = _overviews_of_runs()
    yield from _beside_the_runs(runs)
    yield from _summaries(runs)
    yield from _overviews(overviews)
    yield from _single_fault_reliability(overviews)
    yield from _multiple_fault_reliability(runs)
    yield from _deviations(runs)


def printed_means_that_differ() -> pd.DataFrame:
    """Return the printed figures that do not follow from the thesis's own runs.

    Returns
    -------
    pandas.DataFrame
        Columns table, cell, unit, printed, recomputed, rounding, as of `Comparison`; by table.
    """
    rows = [one for one in comparisons() if one.differs]
    return pd.DataFrame(rows, columns=list(Comparison._fields)).sort_values("table", kind="stable")


def wrong_means() -> list[WrongMean]:
    """Return the means of tables 58 and 59 that are not those of their runs."""
    ours = _overviews_of_runs()
    tables = printed_runs().groupby(["algorithm", "level", "fault"])["table"].max()
    found = []
    for table, quantity in OVERVIEWS.items():
        half = _HALF_OF_RUN[quantity] + _HALF_OF_OVERVIEW[quantity]
        recomputed = _cells(ours[table][list(SINGLE_FAULTS)].drop(index=(MEAN, "")))
        printed = _cells(overview(table))
        found += [
            WrongMean(table, algorithm, level, fault, there, mean, int(tables[cell]))
            for cell, mean in recomputed.items()
            for (algorithm, level, fault), there in [(cell, printed[cell])]
            if abs(there - mean) > half
        ]
    return found


def overviews_with(wrong: Iterable[WrongMean]) -> dict[int, pd.DataFrame]:
    """Return tables 58 and 59 of the runs, by number, but for some means as printed."""
    cells = {
        table: ours[list(SINGLE_FAULTS)].drop(index=(MEAN, ""))
        for table, ours in _overviews_of_runs().items()
    }
    for one in wrong:
        cells[one.table].loc[(one.algorithm, one.level), one.fault] = one.printed
    return {table: with_margins(means) for table, means in cells.items()}


def _overviews_of_runs() -> dict[int, pd.DataFrame]:
    return {table: overview_of(printed_runs(), name) for table, name in OVERVIEWS.items()}


def _cells(frame: pd.DataFrame) -> dict[Any, Any]:
    """Return the cells of a table by the names of row and column in one tuple."""
    return frame.stack(list(range(frame.columns.nlevels))).to_dict()


def _beside_the_runs(runs: pd.DataFrame) -> Iterator[Comparison]:
    ours = _cells(runs.groupby(["table", "algorithm"])[list(_UNITS)].mean())
    for (table, algorithm, quantity), printed in _cells(run_means()).items():
        yield _mean(table, algorithm.upper(), quantity, printed, ours[table, algorithm, quantity])


def _summaries(runs: pd.DataFrame) -> Iterator[Comparison]:
    ours = {table: _cells(fault_means_of(runs, fault)) for table, fault in SUMMARIES.items()}
    for (table, level, quantity), printed in _cells(fault_means()).items():
        yield _mean(table, level, quantity, printed, ours[table][level, quantity])


def _mean(table: int, row: str, quantity: str, printed: float, recomputed: float) -> Comparison:
    half = _HALF_OF_RUN[quantity] + _HALF_OF_MEAN[quantity]
    cell = f"{row}, {_NOUNS[quantity]}"
    return Comparison(table, cell, _UNITS[quantity], printed, recomputed, half)


def _overviews(overviews: Mapping[int, pd.DataFrame]) -> Iterator[Comparison]:
    for table, quantity in OVERVIEWS.items():
        ours = _cells(overviews[table])
        for (algorithm, level, column), printed in _cells(overview(table)).items():
            if math.isnan(printed):
                continue
            members = _FIVE_MEMBERS if column == SIGMA else 1.0
            row = f"{algorithm.upper()} {level}" if level else algorithm
            yield Comparison(
                table,
                f"{row}, {column.replace('_', ' ')}",
                _UNITS[quantity],
                printed,
                ours[algorithm, level, column],
                members * _HALF_OF_RUN[quantity] + _HALF_OF_OVERVIEW[quantity],
            )


def _single_fault_reliability(overviews: Mapping[int, pd.DataFrame]) -> Iterator[Comparison]:
    ours = _cells(reliability_of_overviews(overviews[59], overviews[58]))
    printed = _cells(reliability_single())
    errors, times = (overviews[table].groupby(level="algorithm").mean() for table in (58, 59))
    shares = _HALF_OF_RUN["error_percent"] / errors + _HALF_OF_RUN["time_s"] / times
    for fault in (*SINGLE_FAULTS, TOTAL):
        yield from _reliability(
            60,
            f"{fault.replace('_', ' ')}, ",
            {(row, what): printed[row, fault, what] for row, one, what in printed if one == fault},
            {(row, what): ours[row, fault, what] for row, one, what in ours if one == fault},
            shares[fault].to_dict(),
            half_of_product=0.5,
        )


def _multiple_fault_reliability(runs: pd.DataFrame) -> Iterator[Comparison]:
    ours = multiple_fault_reliability(runs, SPEED_STUDY, PRECISION_STUDY)
    # The products are those of the rounded means beside the runs.
    shares = (
        _HALF_OF_MEAN["error_percent"] / ours["error_percent"]
        + _HALF_OF_MEAN["time_s"] / ours["time_s"]
    )
    yield from _reliability(
        61,
        "",
        _cells(reliability_multiple()),
        _cells(ours),
        shares.to_dict(),
        half_of_product=0.005,
    )


def _reliability(
    table: int,
    name: str,
    printed: dict[Any, Any],
    ours: dict[Any, Any],
    shares: dict[Any, Any],
    half_of_product: float,
) -> Iterator[Comparison]:
    """Yield products, coefficients and the sum; ``shares``: what the products may be off by."""
    product, total = "time x error", ours[SUM, "time x error"]
    moved = 0.0
    for algorithm in ALGORITHMS:
        row = f"{name}{algorithm.upper()}"
        of_product, of_coefficient = (algorithm, product), (algorithm, "RC")
        move = ours[of_product] * shares[algorithm]
        moved += move
        yield Comparison(
            table,
            f"{row}, {product}",
            "s.%",
            printed[of_product],
            ours[of_product],
            move + half_of_product,
        )
        part = ours[of_product] / total
        others = max(shares[other] for other in ALGORITHMS if other != algorithm)
        yield Comparison(
            table,
            f"{row}, RC",
            "%",
            printed[of_coefficient],
            ours[of_coefficient],
            100.0 * part * (1.0 - part) * (shares[algorithm] + others) + _HALF_OF_RC,
        )
    yield Comparison(
        table,
        f"{name}{SUM} of {product}",
        "s.%",
        printed[SUM, product],
        total,
        moved + half_of_product,
    )


def _deviations(runs: pd.DataFrame) -> Iterator[Comparison]:
    of_table = runs[runs["table"] == PRECISION_STUDY]
    deviations = of_table.groupby("algorithm")["error_percent"].std().to_dict()
    for algorithm, printed in multiple_deviations().items():
        half_of_printed = 0.5 * 10.0 ** -len(str(printed).partition(".")[2])
        yield Comparison(
            PRECISION_STUDY,
            f"{algorithm.upper()}, {SIGMA} of the error (section 7.3)",
            "%",
            printed,
            deviations[algorithm],
            _TEN_MEMBERS * 0.0005 + half_of_printed,
        )
