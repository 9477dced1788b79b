"""Inputs that others may have written raise nothing, and take neither long nor much memory."""

import pytest

# A process of a target takes seconds to load: two kinds of file here, the others below.
QUICK = {"bag": 0, "history": 8}
OTHERS = [number for number in range(12) if number not in QUICK.values()]


@pytest.mark.slow
@pytest.mark.parametrize("name", QUICK)
def test_some_inputs(held, name: str):
    assert held("fuzz", QUICK[name], 60) == {f"inputs of {name}": 60}


@pytest.mark.long
@pytest.mark.parametrize("number", OTHERS)
def test_inputs_of_each_target(held, number: int):
    (count,) = held("fuzz", number, 1000).values()
    assert count == 1000
