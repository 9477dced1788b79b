# SPDX-License-Identifier: Apache-2.0
"""Lifecycle of a node: it answers and survives all requests in any order."""

from hypothesis import strategies as st
from hypothesis.stateful import invariant, precondition, rule
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.context import Context
from rclpy.impl.logging_severity import LoggingSeverity

from ema_ros.managed_node import ManagedNode

from .stateful import Walk

_STEPS = {
    Transition.TRANSITION_CONFIGURE: ("configure", "unconfigured", "inactive"),
    Transition.TRANSITION_ACTIVATE: ("activate", "inactive", "active"),
    Transition.TRANSITION_DEACTIVATE: ("deactivate", "active", "inactive"),
    Transition.TRANSITION_CLEANUP: ("clean_up", "inactive", "unconfigured"),
    200: ("what there is not", "never", "never"),
}
# The other transitions release resources. If they fail, the node releases everything.
_MAY_BE_REFUSED = (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE)
_SHUTDOWN = {
    "unconfigured": Transition.TRANSITION_UNCONFIGURED_SHUTDOWN,
    "inactive": Transition.TRANSITION_INACTIVE_SHUTDOWN,
    "active": Transition.TRANSITION_ACTIVE_SHUTDOWN,
}
_ERRORS = {"": None, "refused": ValueError("no such file"), "broken": KeyError("no such file")}
_how = st.sampled_from(("", "", "", "", "refused", "broken"))


class _Node(ManagedNode):
    """A node whose steps raise the exception ``error``, if set."""

    def __init__(self, context: Context) -> None:
        super().__init__("walked", context=context)
        self.get_logger().set_level(LoggingSeverity.FATAL)
        self.error: Exception | None = None
        self.has: list[str] = []

    def _do(self) -> None:
        error, self.error = self.error, None
        if error is not None:
            raise error

    def configure(self) -> None:
        self._do()
        self.has.append("configured")

    def activate(self) -> None:
        self._do()
        self.has.append("active")

    def deactivate(self) -> None:
        self._do()
        self.has.remove("active")

    def clean_up(self) -> None:
        self._do()
        self.has.remove("configured")


class Lifecycle(Walk):
    """A node, and its expected state."""

    def __init__(self) -> None:
        super().__init__()
        self.context = Context()
        self.context.init()
        self.node = _Node(self.context)
        self.state = "unconfigured"

    def _ask(self, transition: int) -> bool:
        service = getattr(self.node, "_service_change_state")  # noqa: B009  private to rclpy
        request = ChangeState.Request(transition=Transition(id=transition))
        return service.callback(request, ChangeState.Response()).success

    @rule(transition=st.sampled_from(sorted(_STEPS)), how=_how)
    def ask(self, transition: int, how: str) -> None:
        """Request a transition, as any client may; its step may fail."""
        _, begin, end = _STEPS[transition]
        is_possible = self.state == begin
        self.node.error = _ERRORS[how] if is_possible else None
        success = self._ask(transition)
        if not is_possible:
            assert not success, f"{transition} in {self.state} was granted"
            return
        assert success == (not how), f"{transition} in {self.state}: {success} with {how!r}"
        if not how:
            self.state = end
        elif how != "refused" or transition not in _MAY_BE_REFUSED:
            self.state = "unconfigured"

    @precondition(lambda self: self._steps > 15 and self.state != "finalized")
    @rule()
    def shut_down(self) -> None:
        """Shut the node down, late in the walk."""
        assert self._ask(_SHUTDOWN[self.state])
        assert self.node.finished.is_set()
        self.state = "finalized"

    @invariant()
    def state_is_right(self) -> None:
        """Check that the node is in the expected state."""
        assert self.node.state == self.state, f"{self.node.state}, expected {self.state}"
        assert self.node.is_configured == (self.state in ("inactive", "active"))

    def teardown(self) -> None:
        """Destroy the node."""
        super().teardown()
        self.node.destroy_node()
        self.context.try_shutdown()
