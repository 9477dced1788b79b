# SPDX-License-Identifier: Apache-2.0
"""Changes of level are posted to an HTTP server, with retries after failures."""

import json
from http.server import BaseHTTPRequestHandler, HTTPServer
from threading import Thread

from ema_core.levels import ERROR, OK, STALE, WARN
from ema_dashboard import alerts
from ema_interfaces.msg import Health, PlaybackState
from ema_ros import topics

from ...waiting import wait_for
from .session import DashboardSession, wait_for_value

FLAP = {"actuator_id": "flap", "serial_number": "7", "cause": "friction 0.4"}


def test_each_change_of_level_is_posted_until_it_is_accepted(
    session: DashboardSession, tmp_path, monkeypatch, caplog
):
    received, answers = [], [500, 302]

    class Receiver(BaseHTTPRequestHandler):
        def do_POST(self):
            received.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(answers.pop(0) if answers else 204)
            self.end_headers()

    monkeypatch.setattr(alerts, "WAITS_S", (0.01, 0.01))
    address = tmp_path / "address"
    address.write_text("ftp://example.org\n")
    assert not session.unconfigured(alerts=str(address)).bring_up()
    with HTTPServer(("127.0.0.1", 0), Receiver) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        address.write_text(f"http://127.0.0.1:{server.server_port}/\n")
        output = session.source.create_publisher(Health, "health", topics.ALIVE)
        node = session.dashboard(alerts=str(address))
        assert node._alerts
        levels = node._alerts._levels
        for level in (STALE, OK, OK, WARN, WARN, ERROR):
            output.publish(Health(level=level, **FLAP))
            wait_for(lambda at=level: levels.get(("/ema", "flap")) == at, f"level {level}")
        wait_for_value(node, "alerts sent", 3)
        changes = [(alert["before"], alert["level"]) for alert in received]
        # The server refused the first change twice.
        assert changes == [("STALE", "OK")] * 3 + [("OK", "WARN"), ("WARN", "ERROR")]
        assert received[-1]["reason"] == "friction 0.4"
        assert received[-1]["rul_50"] is None
        answers += [500, 500, 500]
        output.publish(Health(level=OK, **FLAP))
        wait_for_value(node, "alerts lost", 1)
        assert "status 500" in node.tasks()[0].message
        # Messages of a player concern the past, also before it publishes its range.
        player = session.source.create_publisher(PlaybackState, "playback_state", topics.LATCHED)
        wait_for(node._is_playback, "the player")
        output.publish(Health(level=WARN, **FLAP | {"actuator_id": "of_a_bag"}))
        kept = node._hub._channels["/ema/health"].kept
        wait_for(lambda: "of_a_bag" in kept, "health of the bag")
        session.source.destroy_publisher(player)
        wait_for(lambda: not node._is_playback(), "the end of the player")
        tries = len(received)
        answers += [429, 404]
        output.publish(Health(level=WARN, **FLAP))
        wait_for_value(node, "alerts lost", 2)
        assert [alert["actuator_id"] for alert in received[tries:]] == ["flap"] * 2
        assert "flap: alert WARN lost: status 404" in caplog.messages
        server.shutdown()
