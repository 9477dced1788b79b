"""`ema prognose` says of a bag of tests what the monitor said when they were made."""

from pathlib import Path

from ema_cli.bags.predicting import Predicting
from ema_cli.bags.unit_course import follow
from ema_cli.bags.unit_record import UnitRecord
from ema_interfaces.msg import Health
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.node.messages import health_to_message

from .counted_tests import counted_tests, let_hear, recorded
from .monitor_session import monitor
from .worn_actuator import plain


def offline(record: UnitRecord) -> list[Health]:
    calibration, given = Calibration.builtin(), Predicting()
    course = follow(record, given.estimate(record.windows, calibration), calibration, given)
    return [health_to_message(outlook, record.description) for outlook in course.outlooks]


def test_every_health_message_is_that_of_the_live_monitor_to_the_last_digit(tmp_path: Path):
    tests = counted_tests(8, 0.03)
    with monitor() as session:
        let_hear(session, tests)
        live = session.healths()
    told = offline(recorded(tmp_path / "life.mcap", tests))
    assert [plain(message) for message in told] == [plain(message) for message in live]
    assert [message.flight_hours for message in told] == [item.flight_hours for _, item in tests]
    assert told[-1].rul.known
