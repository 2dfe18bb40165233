"""The sections of domains and problems: text whose tokens are made when they are read."""

from __future__ import annotations

from dataclasses import dataclass

from .tokens import Text, tokenize

# No reader looks further ahead than this without checking.
_ENDS = ["", "", ""]


@dataclass(eq=False, slots=True)
class Section:
    """A section of a domain or a problem: the text from its parenthesis to the next section.

    Attributes:
        text: the text that it is in.
        keyword: its keyword in lower case, such as `:action`; of a head `define`, of what is
            outside of definitions nothing.
        start: the offset in the code where it begins.
        end: the offset where the next section begins, or the code ends.
        last: whether no section of its definition follows.
    """

    text: Text
    keyword: str
    start: int
    end: int
    last: bool = True
    _tokens: list[str] | None = None

    @property
    def tokens(self) -> list[str]:
        """The tokens, and empty ones that stand for the end."""
        if self._tokens is None:
            self._tokens = tokenize(self.text.code[self.start : self.end])
            self._tokens += _ENDS
        return self._tokens

    def forget(self) -> None:
        """Let go of the tokens: they take ten times the room of the text."""
        self._tokens = None
