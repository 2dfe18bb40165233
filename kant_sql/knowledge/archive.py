"""The record of a move into an archive, as text."""

from __future__ import annotations

import json


def archive_text(id_: int, revision: int, target: str, versions: int, rest: str) -> str:
    """Write an archive record in canonical form.

    Args:
        id_: its id.
        revision: what ended up to this revision was moved.
        target: where to.
        versions: how many versions.
        rest: the hash of what is left of the revisions up to there.

    Returns:
        The text.
    """
    to = json.dumps(target, ensure_ascii=False)
    return f'(archive {id_} :upto {revision} :to {to} :versions {versions} :rest "{rest}")'
