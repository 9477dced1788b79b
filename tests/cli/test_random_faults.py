"""``ema simulate --random-faults``: the drawn vector, and what it leaves alone."""

import numpy as np
import pytest

from ema_bags.windows import BagWindows
from ema_cli.bags.source import Source, read_windows
from ema_core.faults import FAULT_NAMES, FAULTS, random_faults
from ema_core.telemetry import Telemetry, join

NOISE = ("-p", "noise_gain=1", "--current-noise", "0.05")
SEED_OF_A_CLIPPED_DRAW = 65


@pytest.fixture(scope="module")
def simulated(ema, tmp_path_factory):
    """Simulate to a bag of its own; return what it holds, its telemetry, and what was printed."""

    def run(*arguments: str) -> tuple[BagWindows, Telemetry, str]:
        bag = tmp_path_factory.mktemp("bag") / "case.mcap"
        result = ema("simulate", *arguments, "-o", bag)
        assert result.exit_code == 0, result.stderr
        blocks: list[Telemetry] = []
        found = read_windows(bag, Source(), blocks.append)
        return found, join(blocks), result.stdout

    return run


@pytest.fixture(scope="module")
def drawn(simulated):
    return simulated("--random-faults", "--seed", "7", "--cycles", "2", *NOISE)


def samples(whole: Telemetry) -> np.ndarray:
    return np.array([whole.command, whole.current, whole.position, whole.speed])


def test_faults_follow_from_the_seed_alone_and_hold_in_every_cycle(simulated, drawn):
    first, second = (truth.faults for truth in drawn[0].truths)
    assert np.array_equal(first, second)
    again, other = (simulated("--random-faults", "--seed", seed)[0] for seed in "78")
    assert np.array_equal(first, again.truths[0].faults)
    assert not np.any(first[:-1] == other.truths[0].faults[:-1])


def test_noise_is_that_of_the_same_faults_given_by_hand_which_are_not_printed(simulated, drawn):
    found, telemetry, _ = drawn
    pairs = zip(FAULT_NAMES, found.truths[0].faults.tolist(), strict=True)
    by_hand = ",".join(f"{name}={value!r}" for name, value in pairs)
    _, given, printed = simulated("--fault", by_hand, "--seed", "7", "--cycles", "2", *NOISE)
    assert np.array_equal(samples(telemetry), samples(given))
    assert "drawn" not in printed


def test_faults_are_drawn_from_a_stream_of_their_own(drawn):
    root = np.random.default_rng(7)
    for rng in (*root.spawn(10), root):
        assert not np.any(random_faults(rng)[:-1] == drawn[0].truths[0].faults[:-1])


def test_fault_may_be_written_as_its_label(simulated):
    found, *_ = simulated("--fault", "Short circuit A=0.2")
    assert found.truths[0].faults[FAULT_NAMES.index("short_circuit_a")] == 0.2


def test_short_circuit_beyond_its_range_is_clipped_and_runs(simulated):
    found, telemetry, _ = simulated("--random-faults", "--seed", str(SEED_OF_A_CLIPPED_DRAW))
    faults = dict(zip(FAULT_NAMES, found.truths[0].faults, strict=True))
    assert faults["short_circuit_b"] == 0.99
    assert np.all(np.isfinite(samples(telemetry)))


def test_drawn_faults_are_printed_with_their_meaning(drawn):
    found, _, printed = drawn
    assert "seed 7" in printed
    for fault, value in zip(FAULTS, found.truths[0].faults, strict=True):
        [row] = [line for line in printed.splitlines() if f"│ {fault.name} " in line]
        assert f" {value:.6f} " in row
        assert fault.physical(value) in row
