"""Results in a prompt and in a notebook."""

from abc import abstractmethod
from html import escape


class Displayed:
    """A result with a ``repr`` of one line, whose text a notebook shows.

    A dataclass that inherits from it is made with ``repr=False``.
    """

    @property
    @abstractmethod
    def brief(self) -> str:
        """The result in a few words."""

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.brief}>"

    def _repr_html_(self) -> str:
        """Return the text of the result as a notebook shows it."""
        return f"<pre>{escape(str(self))}</pre>"
