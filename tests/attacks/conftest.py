# SPDX-License-Identifier: Apache-2.0
"""Cases of attacks: a few with a fixed seed, or as many as EMA_ATTACKS says (`make campaign`)."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from .case import Case

SEED = int(os.environ.get("EMA_ATTACKS_SEED", "1"))
CASES = int(os.environ.get("EMA_ATTACKS", "1"))


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Repeat what attacks, by the number of its case."""
    if "case_number" in metafunc.fixturenames:
        metafunc.parametrize("case_number", range(CASES))


@pytest.fixture
def case_of(tmp_path: Path) -> Callable[..., Case]:
    """Make a case by its number and seed."""

    def make(number: int = 0, seed: int = SEED) -> Case:
        return Case(seed, number, tmp_path)

    return make
