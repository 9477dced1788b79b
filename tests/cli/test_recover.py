"""What is intact of a damaged bag becomes a whole one."""

from pathlib import Path

import pytest

from ema_recording.reader import Bag


@pytest.fixture
def damaged(ema, tmp_path: Path) -> Path:
    """A bag that lost its end, as one of a recorder that was killed."""
    path = tmp_path / "killed.mcap"
    assert ema("simulate", "--fault", "friction=0.2", "--cycles", 2, "-o", path).exit_code == 0
    content = path.read_bytes()
    path.write_bytes(content[: len(content) * 2 // 3])
    return path


def test_recovered_bag_is_whole_and_holds_every_intact_message(ema, damaged: Path, tmp_path: Path):
    result = ema("recover", damaged, "-o", tmp_path / "whole")
    assert result.exit_code == 0, result.output
    before, after = Bag(damaged), Bag(tmp_path / "whole")
    assert before.damage
    assert "killed.mcap" in result.stderr
    assert after.damage == ""
    assert list(after.raw_messages()) == list(before.raw_messages())
    assert {name: (t.qos, t.type_hash) for name, t in after.topics.items()} == {
        name: (t.qos, t.type_hash) for name, t in before.topics.items()
    }
    assert f"{sum(t.count for t in after.topics.values())} messages on 5 topics" in result.stdout
    estimated = ema("estimate", tmp_path / "whole", "--json")
    assert '"friction"' in estimated.stdout


def test_bag_is_not_recovered_onto_itself_or_another(ema, damaged: Path, tmp_path: Path):
    content = damaged.read_bytes()
    result = ema("recover", damaged, "-o", damaged, "--force")
    assert (result.exit_code, "give another name" in result.stderr) == (1, True)
    assert damaged.read_bytes() == content
    (tmp_path / "there.mcap").write_bytes(content)
    result = ema("recover", damaged, "-o", tmp_path / "there.mcap")
    assert (result.exit_code, "is there already" in result.stderr) == (1, True)
