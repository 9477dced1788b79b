"""Valid MCAP files are read whole, and of malformed ones the defect is named."""

import pytest


def test_all_features_of_the_specification_are_read(held):
    # All combinations that the specification allows, of the six contents of MCAP's own tests.
    assert held("vectors", 0) == {"valid read": 440}


def test_drawn_files_are_read_whole(held):
    assert held("vectors", 2, 60) == {"valid read": 60}


def test_defects_are_named_and_nothing_is_read_that_was_not_written(held):
    # Each kind of defect in each form of file several times.
    counts = held("vectors", 1, 400)
    assert sum(counts.values()) == 400
    assert counts["malformed refused"] > 10


@pytest.mark.long
@pytest.mark.parametrize("number", [3, 4, 5, 6])
def test_a_thousand_files_more(held, number: int):
    held("vectors", number)
