"""Every command reads what ``ros2 bag record`` compressed as it reads the same uncompressed."""

import subprocess
from pathlib import Path

import pytest

from ema_recording.reader import Bag

from ..ros import compressed
from ..waiting import DEADLINE_S
from .conftest import Ema

SAMPLE = Path(__file__).parents[2] / "bags" / "faulty_flap.mcap"


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("compressed")
    count = sum(topic.count for topic in Bag(SAMPLE).topics.values())
    by_file = compressed.by_file([SAMPLE], folder / "by_file", count)
    return [
        compressed.by_message(SAMPLE, folder / "by_message"),
        by_file,
        by_file / "by_file_0.mcap.zstd",
    ]


def test_info_is_the_same(ema: Ema, bags: list[Path]):
    def told(bag: Path) -> list[str]:
        result = ema("info", bag)
        assert result.exit_code == 0, result.output
        return [line for line in result.output.splitlines() if not line.startswith("written by")]

    for bag in bags:
        assert told(bag) == told(SAMPLE)


@pytest.mark.slow
def test_estimate_is_the_same_to_the_last_digit(ema: Ema, bags: list[Path], tmp_path: Path):
    def estimates(bag: Path) -> list[str]:
        result = ema("estimate", bag)
        assert result.exit_code == 0, result.output
        # The search says how long it took.
        return [line for line in result.output.splitlines() if " evaluations in " not in line]

    for bag in bags:
        assert estimates(bag) == estimates(SAMPLE)


def test_recover_writes_it_uncompressed(ema: Ema, bags: list[Path], tmp_path: Path):
    for number, bag in enumerate(bags):
        path = tmp_path / f"{number}.mcap"
        assert ema("recover", bag, "-o", path).exit_code == 0
        assert ema("info", path).exit_code == 0
        telemetry = [item.message for item in Bag(SAMPLE).raw_messages(["/ema/telemetry"])]
        assert [item.message for item in Bag(path).raw_messages(["/ema/telemetry"])] == telemetry


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("record", "-o", "a.mcap", "--max-bag-size", "1000000"), "is one file: expected a folder"),
        (("play", str(SAMPLE), "--start-offset", "1000"), "start_offset = 1000 s is beyond"),
        (("play", str(SAMPLE), "--topic", "telemetri"), "did you mean '/ema/telemetry'"),
    ],
)
def test_impossible_options_are_one_clear_line(words: tuple[str, ...], told: str, tmp_path: Path):
    result = subprocess.run(
        ["ema", *words], cwd=tmp_path, stderr=subprocess.PIPE, text=True, timeout=DEADLINE_S
    )
    assert result.returncode == 1
    [line] = result.stderr.splitlines()
    assert told in line
