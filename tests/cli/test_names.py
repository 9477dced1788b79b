"""Names as they are shown and as they are typed mean the same, and slips are recognised."""

import pytest

from ema_bags.reader import Bag


def test_fault_may_be_written_as_its_label(ema, tmp_path):
    bag = tmp_path / "case.mcap"
    assert ema("simulate", "--fault", "Short circuit A=0.2", "-o", bag).exit_code == 0
    [truth] = [item.message.faults for item in Bag(bag).messages(["/ema/simulated_faults"])]
    assert (truth.short_circuit_a, truth.short_circuit_b) == (0.2, 0.0)


@pytest.mark.parametrize(
    ("arguments", "code", "meant"),
    [
        (("estimat", "a.mcap"), 2, "estimate"),
        (("simulate", "--fault", "excentricity=0.1", "-o", "a.mcap"), 1, "eccentricity"),
        (("simulate", "-p", "plant.rs=2", "-o", "a.mcap"), 1, "plant.R_s"),
        (("simulate", "-p", "command.amplitud=1", "-o", "a.mcap"), 1, "command.amplitude"),
        (("estimate", "a.mcap", "--algorithm", "least-square"), 2, "least_squares"),
        (("compare", "a.mcap", "--algorithms", "ga,gwu"), 2, "gwo"),
        (("lives", "--fault", "backlas", "-o", "lives"), 2, "backlash"),
        (("prognose", "a.mcap", "--limit", "frictoin=0.4"), 1, "friction"),
        (("prognose", "a.mcap", "--known-law", "friction=exponentail"), 1, "exponential"),
    ],
)
def test_slip_is_answered_with_what_was_meant(ema, arguments, code, meant):
    result = ema(*arguments)
    assert result.exit_code == code
    assert f"did you mean {meant!r}?" in result.stderr
