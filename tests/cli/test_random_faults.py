"""``ema simulate --random-faults``: the drawn vector, and what it leaves alone."""

import numpy as np
import pytest

from ema_bags.windows import BagWindows
from ema_cli.bags.source import Source, read_windows
from ema_core.faults import FAULT_NAMES, FAULTS, random_faults
from ema_core.telemetry import Telemetry, join

NOISE = ("-p", "noise_gain=1", "--current-noise", "0.05")
SEED_OF_A_CLIPPED_DRAW = 65


@pytest.fixture
def simulated(ema, tmp_path):
    """Simulate to a bag of its own; return what it holds, its telemetry, and what was printed."""

    def run(*arguments: str) -> tuple[BagWindows, Telemetry, str]:
        bag = tmp_path / "case.mcap"
        result = ema("simulate", *arguments, "--replace", "-o", bag)
        assert result.exit_code == 0, result.stderr
        blocks: list[Telemetry] = []
        found = read_windows(bag, Source(), blocks.append)
        return found, join(blocks), result.stdout

    return run


def samples(whole: Telemetry) -> np.ndarray:
    return np.array([whole.command, whole.current, whole.position, whole.speed])


def test_same_seed_same_faults_and_same_telemetry(simulated):
    one, other = (simulated("--random-faults", "--seed", "7", *NOISE) for _ in range(2))
    assert np.array_equal(one[0].truths[0].faults, other[0].truths[0].faults)
    assert np.array_equal(samples(one[1]), samples(other[1]))


def test_another_seed_draws_other_faults(simulated):
    one, other = (simulated("--random-faults", "--seed", seed)[0] for seed in ("7", "8"))
    assert not np.any(one.truths[0].faults[:-1] == other.truths[0].faults[:-1])


def test_drawn_faults_hold_in_every_cycle(simulated):
    found, *_ = simulated("--random-faults", "--seed", "7", "--cycles", "2")
    assert len(found.windows) == 2
    first, second = (truth.faults for truth in found.truths)
    assert np.array_equal(first, second)
    assert found.simulated_faults


def test_noise_is_that_of_the_same_faults_given_by_hand(simulated):
    drawn, telemetry, _ = simulated("--random-faults", "--seed", "7", *NOISE)
    pairs = zip(FAULT_NAMES, drawn.truths[0].faults.tolist(), strict=True)
    by_hand = ",".join(f"{name}={value!r}" for name, value in pairs)
    _, given, _ = simulated("--fault", by_hand, "--seed", "7", *NOISE)
    assert np.array_equal(samples(telemetry), samples(given))


def test_faults_are_drawn_from_a_stream_of_their_own(simulated):
    found, *_ = simulated("--random-faults", "--seed", "7")
    root = np.random.default_rng(7)
    for rng in (*root.spawn(10), root):
        assert not np.any(random_faults(rng)[:-1] == found.truths[0].faults[:-1])


def test_short_circuit_beyond_its_range_is_clipped_and_runs(simulated):
    found, telemetry, _ = simulated("--random-faults", "--seed", str(SEED_OF_A_CLIPPED_DRAW))
    faults = dict(zip(FAULT_NAMES, found.truths[0].faults, strict=True))
    assert faults["short_circuit_b"] == 0.99
    assert np.all(np.isfinite(samples(telemetry)))


def test_drawn_faults_are_printed_with_their_meaning(simulated):
    found, _, printed = simulated("--random-faults", "--seed", "7")
    assert "seed 7" in printed
    for fault, value in zip(FAULTS, found.truths[0].faults, strict=True):
        [row] = [line for line in printed.splitlines() if f"│ {fault.name} " in line]
        assert f" {value:.6f} " in row
        assert fault.physical(value) in row


def test_faults_given_by_hand_are_not_printed_as_drawn(simulated):
    assert "drawn" not in simulated("--fault", "friction=0.2")[2]
