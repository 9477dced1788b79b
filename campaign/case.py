#!/usr/bin/env python3
"""Do one case of the campaign, in this process.

    python campaign/case.py PART --seed SEED --case NUMBER

It is the very case that ``run.py`` did, whatever ran before. Fails when something did not hold.
"""

import json
import sys
import tempfile
import traceback
from pathlib import Path

import click
from part import Case
from parts import NAMES, part_of


@click.command(help=(__doc__ or "").splitlines()[0])
@click.argument("name", metavar="PART", type=click.Choice(NAMES))
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True)
@click.option("--case", "number", type=click.IntRange(0), required=True, help="Its number.")
@click.option("--steps", type=click.IntRange(1), help="Do its first steps alone.")
@click.option("--folder", type=click.Path(path_type=Path), help="Where it leaves what it found.")
@click.option("--result", type=click.Path(path_type=Path), help="Write what was found as JSON.")
def main(
    name: str, seed: int, number: int, steps: int | None, folder: Path | None, result: Path | None
) -> None:
    """Do the case."""
    if folder is None:
        folder = Path(tempfile.mkdtemp(prefix=f"campaign_{name}_{number}_"))
        click.echo(f"in {folder}", err=True)
    case = Case(seed, number, folder, steps)
    try:
        part_of(name).run(case)
    except Exception as error:
        traceback.print_exc()
        case.fail(f"raised {error!r}")
    found = case.result()
    text = json.dumps(found, indent=1)
    if result is not None:
        result.write_text(text)
    else:
        click.echo(text)
    sys.exit(1 if case.failures else 0)


if __name__ == "__main__":
    main()
