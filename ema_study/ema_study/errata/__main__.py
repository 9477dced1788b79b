"""Prints the errata as a page: ``python -m ema_study.errata > docs/errata.md``."""

from ema_study.errata import errata

_HEAD = """\
# Errata of the thesis

Slips of the thesis that this project follows, each with what shows it. `make errata` writes this
page anew; the figures are computed from the thesis's 500 printed runs and from the models. The
numbers of equations, tables, sections and appendices are the thesis's.

| where | printed | found | evidence |
|---|---|---|---|"""


def main() -> None:
    """Print the page."""
    print(_HEAD)
    for erratum in errata():
        cells = (" ".join(cell.replace("|", "\\|").split()) for cell in erratum)
        print(f"| {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
