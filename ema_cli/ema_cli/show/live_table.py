# SPDX-License-Identifier: Apache-2.0
"""Display of live diagnoses: a table on a terminal, otherwise a line per diagnosis."""

from collections.abc import Sequence
from itertools import takewhile
from typing import Final

import click
import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ema_cli.bags.diagnoses import DiagnosedWindow
from ema_cli.show.terminal import COLOURS, TerminalDisplay
from ema_core.faults import FAULT_NAMES, FAULTS
from ema_core.levels import LEVEL_NAMES

_LINES_BESIDE: Final = 8
_TITLE: Final = "normalised faults: true → estimated ± sigma"
_WIDTH: Final = len("0.000 → 0.000 ± 0.000")


class LiveTable(TerminalDisplay):
    """Shows diagnoses as they are received; a context manager."""

    def __init__(self, fault_names: Sequence[str], console: Console | None = None) -> None:
        super().__init__(console)
        self._faults = [FAULT_NAMES.index(name) for name in fault_names]
        self._written = 0

    def show(
        self, diagnoses: Sequence[DiagnosedWindow], state: str, *, final: bool = False
    ) -> None:
        """Show the diagnoses so far, and ``state`` as a note.

        Without a terminal, the last diagnosis waits for its health, unless ``final`` is set.
        """
        if self._console.is_terminal:
            self._live.update(self._diagnosed(diagnoses, state), refresh=True)
            return
        while self._written < len(diagnoses):
            window = diagnoses[self._written]
            is_last = self._written == len(diagnoses) - 1
            # The health is published shortly after the estimate.
            if window.level is None and window.valid and is_last and not final:
                return
            if not self._written:
                labels = [f"{FAULTS[i].label:{_WIDTH}}" for i in self._faults]
                click.echo(f"{_TITLE}, 0 is healthy")
                click.echo("  ".join(("cycle", *labels, "level", "latency", "why")))
            click.echo(self._line(window))
            self._written += 1

    def _diagnosed(self, diagnoses: Sequence[DiagnosedWindow], state: str) -> Table:
        cause = ""
        if diagnoses and (last := diagnoses[-1]).cause:
            # Show the reason for the latest level, and the cycle in which the level began.
            *_, first = takewhile(lambda window: window.level == last.level, reversed(diagnoses))
            cause = f"{_level(last)} since cycle {_cycle(first)}, now: {last.cause}"
        table = self._table(_TITLE, cause, state)
        table.add_column("cycle", justify="right")
        for i in self._faults:
            table.add_column(FAULTS[i].label, justify="center", overflow="fold")
        table.add_column("level")
        table.add_column("latency", justify="right")
        for window in diagnoses[-max(3, self._console.height - _LINES_BESIDE) :]:
            level = Text(
                _level(window), COLOURS.get(-1 if window.level is None else window.level, "")
            )
            faults = [_fault_text(window, i).replace(" ", "") for i in self._faults]
            table.add_row(_cycle(window), *faults, level, f"{window.latency_s:.2f} s")
        return table

    def _line(self, window: DiagnosedWindow) -> str:
        faults = [f"{_fault_text(window, i):{_WIDTH}}" for i in self._faults]
        parts = [
            f"{_cycle(window):>5}",
            *faults,
            f"{_level(window):5}",
            f"{window.latency_s:5.2f} s",
        ]
        return "  ".join((*parts, window.cause if window.valid else window.reason)).rstrip()


def _cycle(window: DiagnosedWindow) -> str:
    return "?" if window.cycle is None else str(window.cycle)


def _level(window: DiagnosedWindow) -> str:
    return "-" if window.level is None else LEVEL_NAMES[window.level]


def _fault_text(window: DiagnosedWindow, i: int) -> str:
    true = "?" if window.truth is None else f"{window.truth[i]:.3f}"
    if not window.valid:
        return f"{true} → none"
    sigma = "?" if np.isnan(window.sigma[i]) else f"{window.sigma[i]:.3f}"
    return f"{true} → {window.faults[i]:.3f} ± {sigma}"
