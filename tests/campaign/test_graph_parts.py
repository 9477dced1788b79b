"""Some cases of the campaign's graphs, with fixed seeds; `make campaign` does many more."""

import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from std_msgs.msg import String

from ema_recording.writer import BagWriter
from ema_ros.topics import STREAM

CAMPAIGN = Path(__file__).parents[2] / "campaign"

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def module_of() -> Callable[[str], Any]:
    def find(name: str) -> Any:
        with pytest.MonkeyPatch.context() as patch:
            patch.syspath_prepend(str(CAMPAIGN))
            return importlib.import_module(name)

    return find


@pytest.fixture
def case_of(module_of: Callable[[str], Any], tmp_path: Path) -> Callable[..., Any]:
    def make(seed: int = 1, number: int = 0, **more: Any) -> Any:
        return module_of("part").Case(seed, number, tmp_path, **more)

    return make


def test_killed_nodes_lose_the_open_chunk_or_the_current_test_alone(
    module_of: Callable[[str], Any], case_of: Callable[..., Any]
):
    # With this seed the monitor, the recorder and the dashboard are killed in turn.
    case = case_of(180)
    module_of("killed_nodes").NodeKills(case, 3, 1, 0.0).run()
    assert case.failures == []
    killed = {
        name: case.counts[f"kills of {name}"] for name in ("monitor", "recorder", "dashboard")
    }
    assert set(killed.values()) == {1}
    assert case.counts["kills of player"] == 1
    assert case.counts["tests in histories checked"] > 0
    assert case.counts["messages read back"] > 100


class Unsent:
    """An observer of a graph in which telemetry was sent every 10 ms."""

    def __init__(self, first_ns: int, blocks: int) -> None:
        sent_ns = [first_ns + 10_000_000 * number for number in range(blocks)]
        self.blocks = [(at_ns, at_ns * 1e-9) for at_ns in sent_ns]


def test_recorder_that_left_nothing_is_excused_only_when_it_had_hardly_begun(
    module_of: Callable[[str], Any], case_of: Callable[..., Any], tmp_path: Path
):
    case = case_of()
    losses = module_of("kill_losses")
    (tmp_path / "empty.mcap").touch()
    for name in ("empty.mcap", "missing"):
        path = tmp_path / name
        for is_due in (False, True):
            losses.check_bag(case, path, is_closed=False, is_due=is_due)
            losses.measure_loss(case, path, Unsent(0, 1), 1.0, is_due=is_due)
            assert len(case.failures) == (2 if is_due else 0)
        case.failures.clear()


def test_recorder_that_lost_more_than_it_may_fails(
    module_of: Callable[[str], Any], case_of: Callable[..., Any], tmp_path: Path
):
    case, sent = case_of(), Unsent(10**18, 300)
    path = tmp_path / "bag.mcap"
    with BagWriter(path) as bag:
        bag.add_topic("/ema/telemetry", String, STREAM)
        for at_ns, _ in sent.blocks[:200]:
            bag.write("/ema/telemetry", String(), at_ns)
    for lost_s, failures in ((0.9, 0), (1.01, 1)):  # 0.5 s of flush_s and 0.5 s
        killed_s = sent.blocks[200][1] + lost_s
        module_of("kill_losses").measure_loss(case, path, sent, killed_s, is_due=True)
        assert len(case.failures) == failures


@pytest.mark.long
def test_archive_whose_workers_are_killed_is_whole(
    module_of: Callable[[str], Any], case_of: Callable[..., Any]
):
    case = case_of(5)
    module_of("killed_archive").run(case, 3)
    assert case.failures == []
    victims = module_of("killed_archive").VICTIMS
    assert sum(case.counts[f"kills of {victim}"] for victim in victims) == 3


def test_graph_whose_monitor_is_restarted_keeps_all_rules(
    module_of: Callable[[str], Any], case_of: Callable[..., Any]
):
    case = case_of()
    module_of("graphs").run_condition(case, "restart of the monitor", 3.0, 3.0)
    assert case.failures == []
    assert case.counts["runs"] == 2
    assert case.counts["valid"] >= 2


@pytest.mark.long
@pytest.mark.parametrize("number", range(9))
def test_disturbed_graph_keeps_all_rules(
    module_of: Callable[[str], Any], case_of: Callable[..., Any], number: int
):
    case = case_of(2, number)
    module_of("graphs").run(case)
    assert case.failures == []
    assert case.counts["windows"] > 3


@pytest.mark.long
def test_nodes_that_are_killed_or_stand_still_are_missed_and_go_on(
    module_of: Callable[[str], Any], case_of: Callable[..., Any]
):
    case = case_of(3)
    module_of("kills").run(case)
    assert case.failures == []


@pytest.mark.long
def test_no_window_of_a_unit_is_wrong_and_confident(
    module_of: Callable[[str], Any], case_of: Callable[..., Any]
):
    # A hundred windows show a share of 3 % and more, not the 0.1 % of the campaign.
    part, case = module_of("wrong_and_confident"), case_of(steps=1)
    part.run(case)
    assert case.counts["windows, cold"] > 80
    assert part.judge(case.counts) == []
