# SPDX-License-Identifier: Apache-2.0
"""Cases of attacks: one with a fixed seed, or EMA_ATTACKS cases (`make campaign`)."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from .case import Case

SEED = int(os.environ.get("EMA_ATTACKS_SEED", "1"))
CASES = int(os.environ.get("EMA_ATTACKS", "1"))


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Repeat tests with the argument ``case_number`` for each case."""
    if "case_number" in metafunc.fixturenames:
        metafunc.parametrize("case_number", range(CASES))


@pytest.fixture
def case_of(tmp_path: Path) -> Callable[..., Case]:
    """Return a function that makes a case from its number and seed."""

    def make(number: int = 0, seed: int = SEED) -> Case:
        return Case(seed, number, tmp_path)

    return make
