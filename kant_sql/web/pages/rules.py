"""The page of rules: those that are kept, who saved each, and how it stands."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from ...errors import KantSqlError, QuestionCancelledError
from ...history.revisions import Revision
from ...knowledge_base import KnowledgeBase, state_of
from ...reasoning.kept_rules import KeptRule, read_saved
from ...reasoning.rule_watch import standing
from ...reasoning.rules import WORDS, Verdict
from ..registry import Pages

PAGES = Pages("rules")

# How many verdicts of a rule a page has.
MOST_VERDICTS = 20


@dataclass(frozen=True)
class ListedRule:
    """A kept rule, and the revision that saved its present form.

    A quantifier around a rule makes a verdict for each object: `counts` says how many there are of
    each word, and `verdicts` has the worst; null where they are not judged.
    """

    _json_ = "*rule", "saved", "counts", "verdicts"

    rule: KeptRule
    saved: Revision
    counts: Mapping[str, int] | None = field(hash=False)
    verdicts: list[Verdict] | None = field(hash=False)


class RulesPage(NamedTuple):
    """All kept rules, in the order in which they were first saved.

    `error` says why they are not judged, as when it takes too long; null if they are.
    """

    rules: list[ListedRule]
    error: str | None


@PAGES.page("/rules", "rules.html", rows=["rules"])
def rules(kb: KnowledgeBase) -> RulesPage:
    """Show the kept rules, who saved each and when, and its verdict."""
    saved = read_saved(state_of(kb))
    try:
        verdicts = standing(state_of(kb)).worst_first
    except QuestionCancelledError:
        raise
    except KantSqlError as error:
        return RulesPage([ListedRule(*one, None, None) for one in saved], str(error))
    by_name: dict[str | None, list[Verdict]] = defaultdict(list)
    for verdict in verdicts:
        by_name[verdict.name].append(verdict)
    listed = []
    for rule, revision in saved:
        own = by_name[rule.name]
        found = Counter(one.verdict for one in own)
        counts = {word: found[word] for word in WORDS}
        listed.append(ListedRule(rule, revision, counts, own[:MOST_VERDICTS]))
    return RulesPage(listed, None)
