"""A few cases of each part of the campaign, with a fixed seed, in this process."""

import importlib
from collections.abc import Callable
from pathlib import Path

import pytest

CAMPAIGN = Path(__file__).parents[2] / "campaign"
SEED = 1


@pytest.fixture(scope="session", autouse=True)
def _modules() -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(CAMPAIGN))
        for name in ("run", *importlib.import_module("parts").NAMES):
            importlib.import_module(name)


@pytest.fixture
def held(tmp_path: Path) -> Callable[..., dict[str, int]]:
    """Do a case of a part; fail with what did not hold, return what was counted."""

    def do(name: str, number: int, steps: int | None = None) -> dict[str, int]:
        part, parts = (importlib.import_module(module) for module in ("part", "parts"))
        case = part.Case(SEED, number, tmp_path, steps)
        parts.part_of(name).run(case)
        assert case.failures == []
        return dict(case.counts)

    return do
