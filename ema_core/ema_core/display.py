# SPDX-License-Identifier: Apache-2.0
"""Display of results at a Python prompt and in notebooks."""

from abc import abstractmethod
from html import escape


class Displayed:
    """Base class of results: ``repr`` is one line, and notebooks show ``str``.

    A dataclass that inherits from it needs ``repr=False``.
    """

    @property
    @abstractmethod
    def brief(self) -> str:
        """Summary of the result in a few words."""

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.brief}>"

    def _repr_html_(self) -> str:
        """Return ``str`` of the result as HTML."""
        return f"<pre>{escape(str(self))}</pre>"
