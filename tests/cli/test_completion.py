"""A replay is complete when nothing is on its way any more."""

from ema_cli.completion import Completion


def report(
    blocks: int, windows: int, valid: int, invalid: int = 0, *, name: str = "flap"
) -> dict[str, dict[str, str]]:
    names = ("blocks", "windows", "estimates valid", "estimates invalid")
    counts = (blocks, windows, valid, invalid)
    return {name: dict(zip(names, map(str, counts), strict=True))}


def test_replay_is_complete_when_all_windows_are_identified_and_counts_stand_still():
    replay = Completion()
    for _ in range(3):
        replay.add_report(report(10, 1, 1))
    assert not replay.is_complete
    replay.end()
    for counts in ((20, 2, 1), (20, 2, 1), (20, 2, 1, 1)):
        replay.add_report(report(*counts))
        assert not replay.is_complete
    replay.add_report(report(20, 2, 1, 1))
    assert replay.is_complete


def test_replay_is_complete_when_each_of_several_monitors_is():
    replay = Completion()
    replay.add_report(report(10, 1, 1, name="left"))
    replay.add_report(report(10, 1, 0, name="right"))
    replay.end()
    for _ in range(3):
        # The other one is silent for long: it is identifying.
        replay.add_report(report(10, 1, 1, name="left"))
        assert not replay.is_complete
    for _ in range(2):
        assert not replay.is_complete
        replay.add_report(report(10, 1, 1, name="right"))
        replay.add_report(report(10, 1, 1, name="left"))
    assert replay.is_complete


def test_replay_without_any_actuator_is_not_complete():
    replay = Completion()
    replay.end()
    for _ in range(3):
        replay.add_report({})
    assert not replay.is_complete
