# SPDX-License-Identifier: Apache-2.0
"""Requests of the page to monitors: notes on events, and changes of baselines."""

from collections.abc import Callable
from typing import Any

import pytest

from ema_dashboard.dashboard_node import DashboardNode
from ema_dashboard.monitor_requests import read_baseline_change
from ema_interfaces.srv import ChangeBaseline, NoteEvent

from ...waiting import wait_for
from .session import DashboardSession

NOTE = {"namespace": "/ema", "actuator_id": "flap", "sec": 2, "nanosec": 0, "person": "Ada"}
CHANGE = {
    "namespace": "/ema",
    "actuator_id": "left/elbow",
    "change": "accept",
    "person": " Ada\n",
    "note": "",
    "force": False,
}


class Monitor:
    """The services of a monitor that store notes and change baselines."""

    def __init__(
        self, session: DashboardSession, name: str, refuses: Callable[[Any], str] = lambda _: ""
    ) -> None:
        node = session.node(name)
        node.create_service(NoteEvent, "~/note_event", self._answer)
        node.create_service(ChangeBaseline, "~/change_baseline", self._answer)
        self.refuses = refuses
        self.requests: list[Any] = []

    def _answer(self, request: Any, response: Any) -> Any:
        response.message = self.refuses(request)
        response.success = not response.message
        if response.success:
            self.requests.append(request)
        return response


def post(
    session: DashboardSession, node: DashboardNode, path: str, content: Any, **options: Any
) -> tuple[int, str]:
    arguments = {"json": content} | options
    status, _, answer = session.web.get(f"{node.address}{path}", method="post", **arguments)
    return status, answer.decode()


def test_page_and_programs_with_the_token_may_add_notes(session):
    monitor = Monitor(session, "monitor", lambda note: "not today" * (note.text == "no"))
    node = session.dashboard()

    def posted(text: object, **options: Any) -> tuple[int, str]:
        return post(session, node, "note", NOTE | {"text": text}, **options)

    wait_for(lambda: posted("seen")[0] == 204, "the note is stored")
    [noted] = monitor.requests
    assert (noted.person, noted.stamp.sec) == ("Ada", 2)
    assert posted("no") == (400, "/ema/monitor/note_event: not today\n")
    assert posted("seen", headers={"Origin": "http://example.org"})[0] == 403
    assert posted("seen", json=None, data='{"a": 1}')[0] == 415
    assert posted("x" * 5000)[0] == 413
    for impossible in (3, "", "\ud800"):
        assert posted(impossible)[0] == 400


def test_baseline_is_changed_by_the_monitor_of_the_joint(session):
    unknown = "unknown actuator 'left/elbow'"
    Monitor(session, "other_monitor", lambda _: unknown)
    monitor = Monitor(session, "monitor")
    node = session.dashboard()

    def posted(**fields: Any) -> tuple[int, str]:
        return post(session, node, "baseline", CHANGE | fields)

    wait_for(lambda: posted()[0] == 204, "the baseline is accepted")
    [request] = monitor.requests
    assert (request.actuator_id, request.person, request.note) == ("left/elbow", "Ada", "")
    assert (request.change, request.force) == (ChangeBaseline.Request.ACCEPT, False)
    assert posted(change="reset", note="new gear", force=True)[0] == 204
    assert monitor.requests[1].change == ChangeBaseline.Request.RESET
    assert (monitor.requests[1].note, monitor.requests[1].force) == ("new gear", True)

    monitor.refuses = lambda _: "2 records: a baseline needs at least 3 records"
    status, reason = posted()
    assert status == 400
    # The reason of the joint's monitor is reported, although another monitor refuses too.
    assert "/ema/monitor/change_baseline: 2 records: a baseline needs at least 3 records" in reason
    assert len(monitor.requests) == 2
    assert posted(namespace="/elsewhere") == (400, "this namespace is not shown by the dashboard\n")


def test_baseline_change_of_another_page_is_refused(session):
    monitor, node = Monitor(session, "monitor"), session.dashboard()
    wait_for(lambda: post(session, node, "baseline", CHANGE)[0] == 204, "the baseline is accepted")
    foreign = {"Origin": "http://example.org"}
    assert post(session, node, "baseline", CHANGE, headers=foreign)[0] == 403
    assert post(session, node, "baseline", None, json=None, data="{}")[0] == 415
    assert len(monitor.requests) == 1


def test_baseline_change_without_a_monitor_is_refused(session):
    assert post(session, session.dashboard(), "baseline", CHANGE) == (
        400,
        "no monitor is running\n",
    )


@pytest.mark.parametrize(
    "fields",
    [
        {"change": "calibrate"},
        {"change": 0},
        {"person": ""},
        {"person": 3},
        {"note": None},
        {"force": "yes"},
        {"actuator_id": ""},
    ],
)
def test_invalid_baseline_change_is_refused(fields: dict[str, Any]):
    with pytest.raises(ValueError, match="expected"):
        read_baseline_change(CHANGE | fields)
