"""A node in a process of its own that is brought to a state and says what it does at its end."""

import sys

from ema_ros.managed_node import ManagedNode
from ema_ros.run import run


class Named(ManagedNode):
    """A node that is brought to the state that the command line names."""

    def __init__(self) -> None:
        super().__init__("named")

    def bring_up(self) -> bool:
        """Go as far as is wanted."""
        wanted = sys.argv[1]
        if wanted != "unconfigured":
            self.trigger_configure()
        if wanted == "active":
            self.trigger_activate()
        print(self.state, flush=True)
        return True

    def deactivate(self) -> None:
        """Say so."""
        print("deactivate", flush=True)

    def clean_up(self) -> None:
        """Say so."""
        print("clean_up", flush=True)


if __name__ == "__main__":
    raise SystemExit(run(Named, sys.argv[:1]))
