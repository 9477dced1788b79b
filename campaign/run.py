#!/usr/bin/env python3
"""Attack the monitor for an hour: `make campaign`.

    python run.py [--part NAME]... [--budget SECONDS] [--seed SEED] [--resume FILE]

Each part does numbered cases until its share of the time is used, every case in a process of its
own. After each, the state is written to a file, from which an interrupted campaign goes on. Prints
a table, and each failure with the command that repeats it; fails when there is one.
"""

import signal
import sys
import time
from pathlib import Path
from typing import Final

import click
from part import Part
from parts import NAMES, part_of
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from running import RunningCase
from tally import PartTally, Tally

HERE: Final = Path(__file__).parent
FOUND: Final = HERE / "found"
"""Where what failing cases leave is kept."""

_POLL_S: Final = 0.1


class Campaign:
    """Runs cases, so many at once, and adds up what they find."""

    def __init__(self, parts: list[Part], tally: Tally, state: Path, slots: int) -> None:
        self._parts = parts
        self._tally = tally
        self._state = state
        self._slots = slots
        self._running: list[RunningCase] = []
        self._console = Console(stderr=True)

    def run(self) -> bool:
        """Do cases until the time is used; return False after Ctrl-C, which ends those that run.

        These are not counted: they are done when the campaign is resumed.
        """
        began_s, used_s, told = time.monotonic(), self._tally.used_s, list[int]()
        # Not as an exception, which might come between the start of a case and the note of it.
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda number, _: told.append(number))
        while not told:
            self._tally.used_s = used_s + time.monotonic() - began_s
            while not told and self._start_next(self._tally.budget_s - self._tally.used_s):
                pass
            if not self._running:
                break
            time.sleep(_POLL_S)
            self._collect()
        for case in self._running:
            case.stop()
        self._tally.save(self._state)
        return not told

    def _start_next(self, left_s: float) -> bool:
        """Start the case whose part is furthest behind its share; return whether one was."""
        waiting = [part for part in self._parts if self._has_next(part, left_s)]
        if not waiting:
            return False
        part = min(waiting, key=lambda part: self._spent_s(part) / part.share)
        if self._slots - sum(self._width(case.part) for case in self._running) < self._width(part):
            return False  # those that are further ahead wait as well: else it would for ever
        running = {case.number for case in self._running if case.part is part}
        number = self._tally.of(part.name).next_number(running)
        folder = FOUND / f"{part.name}_{self._tally.seed}_{number}"
        self._running.append(RunningCase(part, self._tally.seed, number, folder))
        return True

    def _has_next(self, part: Part, left_s: float) -> bool:
        running = sum(case.part is part for case in self._running)
        begun = len(self._tally.of(part.name).done) + running
        return left_s >= part.usual_s and (part.most_cases is None or begun < part.most_cases)

    def _width(self, part: Part) -> int:
        return min(part.slots, self._slots)

    def _spent_s(self, part: Part) -> float:
        now_s = time.monotonic()
        mine = [case for case in self._running if case.part is part]
        running_s = sum(now_s - case.began_s + part.usual_s for case in mine)
        return self._width(part) * (self._tally.of(part.name).spent_s + running_s)

    def _collect(self) -> None:
        """Add up the cases that have ended."""
        for case in list(self._running):
            outcome = case.poll()
            if outcome is None:
                continue
            self._running.remove(case)
            self._tally.of(case.part.name).add(
                case.number, outcome.took_s, outcome.memory_mb, outcome.result
            )
            self._tally.save(self._state)
            failed = len(outcome.result["failures"])
            verdict = f"[bold red]{failed} failures[/]" if failed else "held"
            self._console.print(
                f"{case.part.name} case {case.number}: {verdict}, {outcome.took_s:.1f} s"
            )


def failures_of(part: Part, seed: int, tally: PartTally) -> list[str]:
    """Return what did not hold in a part, each with the command that repeats it."""
    lines = []
    for number, failures in tally.failures.items():
        lines += [f"{part.name} case {number}: {failure}" for failure in failures]
        lines.append(
            f"    repeat: python campaign/case.py {part.name} --seed {seed} --case {number}"
        )
    if tally.done:
        lines += [f"{part.name}: {words}" for words in part.judge(tally.counts)]
    return lines


def counted_words(tally: PartTally) -> str:
    """Return what was counted and measured in a part."""
    words = [f"{name} {count:,}" for name, count in sorted(tally.counts.items())]
    words += [f"{name} {value:.4g}" for name, value in sorted(tally.worst.items())]
    return escape("; ".join(words) or "nothing")


def overview(parts: list[Part], tally: Tally) -> Table:
    """Return the table of the parts."""
    title = f"campaign, seed {tally.seed}, {tally.used_s:.0f} s"
    columns = ("part", "cases", "done of what is asked", "failures", "worst time", "worst memory")
    table = Table(*columns, title=title)
    for part in parts:
        own = tally.of(part.name)
        failures = sum(map(len, own.failures.values())) + len(part.judge(own.counts))
        table.add_row(
            f"{part.name}\n[dim]{escape(part.summary)}[/]",
            f"{len(own.done):,}" if own.done else f"none: one takes {part.usual_s:g} s",
            escape("\n".join(map(str, part.goals(own.counts)))),
            f"[bold red]{failures}[/]" if failures else "0",
            f"{own.worst_s:.1f} s",
            f"{own.worst_mb:.0f} MB",
        )
    return table


def _drawn_seed() -> int:
    return time.time_ns() % 2**31


@click.command(help=(__doc__ or "").splitlines()[0])
@click.option("--part", "names", multiple=True, type=click.Choice(NAMES), help="This part alone.")
@click.option(
    "--budget", type=click.FloatRange(0.0, min_open=True),
    help="Time after which no case is begun [s]; 3600.",
)  # fmt: skip
@click.option("--seed", type=click.IntRange(0), help="Of all cases; drawn when not given.")
@click.option(
    "--slots", type=click.IntRange(1, 64), default=2, show_default=True, help="Cases at once."
)
@click.option(
    "--state", type=click.Path(path_type=Path), default=HERE / "campaign.json",
    help="File of the state, and of the figures at the end; campaign/campaign.json.",
)  # fmt: skip
@click.option("--resume", type=click.Path(path_type=Path), help="Go on from the state in a file.")
def main(
    names: tuple[str, ...],
    budget: float | None,
    seed: int | None,
    slots: int,
    state: Path,
    resume: Path | None,
) -> None:
    """Run the campaign; print what was found."""
    console = Console()
    try:
        tally = (
            Tally.load(resume) if resume else Tally(_drawn_seed() if seed is None else seed, 3600.0)
        )
    except (ValueError, OSError) as error:
        raise click.ClickException(str(error)) from error
    if resume and seed not in (None, tally.seed):
        raise click.UsageError(f"--seed {seed}: the campaign of {resume} has seed {tally.seed}")
    state = resume or state
    tally.budget_s = budget or tally.budget_s
    parts = [part_of(name) for name in names or NAMES]
    console.print(f"seed {tally.seed}, {tally.budget_s:g} s, state in {state}", soft_wrap=True)
    if not Campaign(parts, tally, state, slots).run():
        words = f"stopped; to go on: python campaign/run.py --resume {state}"
        console.print(words, soft_wrap=True)
        sys.exit(130)
    console.print(overview(parts, tally))
    for part in parts:
        console.print(f"{part.name}: {counted_words(tally.of(part.name))}", highlight=False)
    failures = [
        line for part in parts for line in failures_of(part, tally.seed, tally.of(part.name))
    ]
    for line in failures:
        console.print(escape(line), style="red", highlight=False, soft_wrap=True)
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
