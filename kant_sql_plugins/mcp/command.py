"""`kant-sql mcp`."""

from __future__ import annotations

from kant_sql.cli.common import Url
from kant_sql.errors import ExtraMissingError

MISSING = "this needs the SDK of the Model Context Protocol; run: pip install 'kant-sql[mcp]'"


def mcp(url: Url) -> None:
    """Answer questions of a program with a language model, over standard input and output.

    It speaks the Model Context Protocol: the program starts this command, as its configuration
    says. All tools only read. Ends when its input does.
    """
    try:
        from .server import serve
    except ImportError as error:
        raise ExtraMissingError(MISSING) from error
    serve(url)
