# SPDX-License-Identifier: Apache-2.0
"""Changed files and actuators of a monitor take effect by cleanup and configuration."""

from pathlib import Path

from lifecycle_msgs.msg import Transition

from .monitor_session import FLAP, MonitorSession, Source, monitor


def cycle_states(session: MonitorSession, *transitions: int) -> None:
    for transition in transitions:
        assert session.change_state(transition)


def test_new_files_and_actuators_take_effect_at_the_next_configure(tmp_path: Path):
    history = tmp_path / "history"
    changes = {
        "calibration_file": f"{tmp_path}/{{actuator_id}}.yaml",
        "history_folder": str(history),
        "actuators": [FLAP.actuator_id],
    }
    with monitor({"actuators": ["rudder"]}) as session:
        session.describe()
        for answer, name in zip(session.set_parameters(**changes), changes, strict=True):
            assert not answer.successful
            assert answer.reason.startswith(f"{name} cannot be changed while the node is active")
        cycle_states(session, Transition.TRANSITION_DEACTIVATE)
        assert all(answer.successful for answer in session.set_parameters(**changes))
        cycle_states(session, Transition.TRANSITION_ACTIVATE)
        assert FLAP.actuator_id not in session.node.actuators
        cycle_states(
            session,
            Transition.TRANSITION_DEACTIVATE,
            Transition.TRANSITION_CLEANUP,
            Transition.TRANSITION_CONFIGURE,
            Transition.TRANSITION_ACTIVATE,
        )
        session.until_subscribed()
        session.mount()
        session.feed(Source().cycle())
        estimate = session.next_estimate()
        assert not estimate.valid
        assert f"{tmp_path}/flap.yaml" in estimate.reason
        # A unit has a history from its first test on, valid or not.
        session.until(lambda: list(history.glob("flap+*.sqlite")))
