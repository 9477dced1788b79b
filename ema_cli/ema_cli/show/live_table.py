"""Diagnoses as they come: a table on a terminal, else a line each."""

from collections.abc import Sequence
from typing import Final

import click
import numpy as np
from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from ema_cli.bags.history import Diagnosed
from ema_core.faults import FAULT_NAMES, FAULTS
from ema_core.levels import ERROR, LEVEL_NAMES, OK, STALE, WARN

_COLOURS: Final = {OK: "green", WARN: "yellow", ERROR: "bold red", STALE: "bright_black"}
_LINES_BESIDE: Final = 8


class LiveTable:
    """Shows diagnoses; to be used under ``with``.

    Parameters
    ----------
    fault_names
        Components that are shown.
    console
        Where; standard output when None.
    """

    def __init__(self, fault_names: Sequence[str], console: Console | None = None) -> None:
        self._faults = [FAULT_NAMES.index(name) for name in fault_names]
        self._console = console or Console()
        self._live = Live(console=self._console, auto_refresh=False)
        self._written = 0

    def __enter__(self) -> "LiveTable":
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._console.is_terminal:
            self._live.stop()

    def tell(self, line: str) -> None:
        """Write a line, above the table if there is one."""
        if self._console.is_terminal:
            self._console.print(line, markup=False, highlight=False)
        else:
            click.echo(line)

    def show(self, diagnoses: Sequence[Diagnosed], state: str, *, final: bool = False) -> None:
        """Show the diagnoses so far.

        Parameters
        ----------
        diagnoses
            All of them.
        state
            What goes on, in a few words.
        final
            Whether nothing more is to come.
        """
        if self._console.is_terminal:
            self._live.update(self._table(diagnoses, state), refresh=True)
            return
        while self._written < len(diagnoses):
            one = diagnoses[self._written]
            is_last = self._written == len(diagnoses) - 1
            # The health comes just after its estimate.
            if one.level is None and one.valid and is_last and not final:
                return
            click.echo(self._line(one))
            self._written += 1

    def _table(self, diagnoses: Sequence[Diagnosed], state: str) -> Table:
        table = Table(
            title="true → estimated ± sigma of the normalised faults",
            title_justify="left",
            caption=state,
            caption_justify="left",
        )
        table.add_column("cycle", justify="right")
        for i in self._faults:
            table.add_column(FAULTS[i].label, justify="center", no_wrap=True)
        table.add_column("level")
        table.add_column("latency", justify="right")
        for one in diagnoses[-max(3, self._console.height - _LINES_BESIDE) :]:
            level = Text(_level(one), _COLOURS.get(-1 if one.level is None else one.level, ""))
            faults = [_figures(one, i) for i in self._faults]
            table.add_row(_cycle(one), *faults, level, f"{one.latency_s:.2f} s")
        return table

    def _line(self, one: Diagnosed) -> str:
        faults = [f"{FAULTS[i].label} {_figures(one, i)}" for i in self._faults]
        parts = [f"cycle {_cycle(one):>3}", *faults, f"{_level(one):5}", f"{one.latency_s:.2f} s"]
        return "   ".join(parts + ([] if one.valid else [one.reason]))


def _cycle(one: Diagnosed) -> str:
    return "?" if one.cycle is None else str(one.cycle)


def _level(one: Diagnosed) -> str:
    return "-" if one.level is None else LEVEL_NAMES[one.level]


def _figures(one: Diagnosed, i: int) -> str:
    true = "?" if one.truth is None else f"{one.truth[i]:.3f}"
    if not one.valid:
        return f"{true} → no estimate"
    sigma = "?" if np.isnan(one.sigma[i]) else f"{one.sigma[i]:.3f}"
    return f"{true} → {one.faults[i]:.3f} ± {sigma}"
