"""The forms of a text, `(define ...)`, and their sections, found without reading their contents.

Declarations may follow their uses, so all sections are found before any of them is read. A section
starts with its `(:keyword` at the right depth of parentheses: this is cheap, and it finds the
section with a missing parenthesis.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import cached_property
from typing import NoReturn

from ..errors import PddlError
from .cursor import END, Cursor, Diagnostics, Section, hint
from .lexer import Text, end_of_tokens, tokenize, unmatched

DOMAIN, PROBLEM = "domain", "problem"
HEAD = "define"
DOMAIN_ORDER = (
    ":requirements",
    ":types",
    ":constants",
    ":predicates",
    ":functions",
    ":constraints",
)
PROBLEM_ORDER = (
    ":domain",
    ":requirements",
    ":objects",
    ":init",
    ":goal",
    ":constraints",
    ":metric",
    ":length",
)
ACTIONS = (":action", ":durative-action", ":process", ":event")
STRUCTURES = (*ACTIONS, ":derived")
_SECTIONS = frozenset(DOMAIN_ORDER + PROBLEM_ORDER + STRUCTURES)

# A section of the other kind of definition, and the section that it is read as.
_ALIASES = {":objects": ":constants", ":constants": ":objects"}
# Sections of older and other languages, which messages name.
_FOREIGN = {
    ":axiom": "PDDL 1.2; use (:derived ...)",
    ":domain-variables": "PDDL 1.2",
    ":extends": "PDDL 1.2",
    ":method": "HTN planning",
    ":safety": "PDDL 1.2",
    ":situation": "PDDL 1.2",
    ":task": "HTN planning",
    ":timeless": "PDDL 1.2",
}

_CUT = re.compile(r"\(\s*(?:(:[^\s()]*)|define\s*\()", re.IGNORECASE)
_DEFINE = re.compile(r"\(\s*define\s*\(", re.IGNORECASE)


@dataclass(eq=False)
class Form:
    """A definition: `(define ...)`."""

    head: Section  # the text before its first section
    sections: list[Section] = field(default_factory=list)  # its sections, in order

    def add(self, section: Section) -> None:
        """Add a section at the end."""
        last = self.sections[-1] if self.sections else self.head
        last.last = False
        self.sections.append(section)

    @cached_property
    def kind(self) -> str:
        """`domain` or `problem`, or another word that follows `define`."""
        return self.head.tokens[3].lower()

    @property
    def name(self) -> str:
        """The name of the domain or problem."""
        return self.head.tokens[4]

    @property
    def domain(self) -> str:
        """The name of a problem's domain; empty without one."""
        return next((one.tokens[2] for one in self.sections if one.keyword == ":domain"), "")

    @property
    def nesting(self) -> str:
        """Kind and name, for messages."""
        return f"{self.kind} {self.name}"


class Scanner:
    """Finds the forms of a text."""

    def __init__(self, diagnostics: Diagnostics, text: Text) -> None:
        self._diagnostics = diagnostics
        self._text = text
        self._code = text.code
        self._forms: list[Form] = []

    def scan(self) -> list[Form]:
        """Find the forms."""
        self._diagnostics.check_comments(self._text)
        self._check_start()
        wrong = unmatched(self._code)
        if wrong is not None:
            offset, missing = wrong
            found = (END, f"{missing} more ')'") if missing else ("')' that closes nothing", END)
            self._refuse(offset, *found)
        if _DEFINE.search(self._code) is None:
            self._refuse_start(0)
        self._split()
        for form in self._forms:
            self._check_head(form)
        return self._forms

    def _refuse(self, offset: int, found: str, expected: str, nesting: str = "") -> NoReturn:
        [place] = self._text.locate([offset])
        raise PddlError(self._text.name, place.line, place.column, found, expected, nesting)

    def _check_start(self) -> None:
        """Refuse a text that cannot be PDDL, by its first tokens."""
        end = end_of_tokens(self._code, 2)
        tokens = tokenize(self._code[:end])
        if tokens[:1] != ["("] or tokens[1:] in ([], ["("], [")"]):
            self._refuse_start(1 if tokens[:1] == ["("] else 0)

    def _refuse_start(self, at: int) -> NoReturn:
        start = Section(self._text, "", 0, end_of_tokens(self._code, 2))
        expected = "(define (domain ...) ...) or (define (problem ...) ...)"
        Cursor(self._diagnostics, start).fail(expected, at=at)

    def _split(self) -> None:
        """Cut the code at each `(define` and at each section."""
        depth, seen = 0, 0
        before = Section(self._text, "", 0, 0)
        for found in _CUT.finditer(self._code):
            start, keyword = found.start(), (found[1] or HEAD).lower()
            depth += self._code.count("(", seen, start) - self._code.count(")", seen, start)
            seen = start
            if depth != (keyword != HEAD):
                self._check_nested(before, start, keyword, depth)
                continue
            before.end = start
            if not before.keyword:
                skip_foreign(Cursor(self._diagnostics, before))
            before = self._begin(start, keyword)
        before.end = len(self._code)
        depth += self._code.count("(", seen) - self._code.count(")", seen)
        if depth > 0:
            expected = f"')' that closes {self._called(before)}"
            self._refuse(len(self._code.rstrip()), END, expected)

    def _check_nested(self, before: Section, start: int, keyword: str, depth: int) -> None:
        """Refuse a section or a form at a wrong depth; accept a nested keyword."""
        level = 0 if keyword == HEAD else 1
        if depth < level:
            outside = f"'({keyword}' outside of a definition: a ')' before it is too many"
            self._refuse(start, outside, "(define")
        if keyword in _SECTIONS or keyword == HEAD:
            self._refuse(start, f"'({keyword}'", f"')' that closes {self._called(before)}")

    def _called(self, section: Section) -> str:
        """Return the name of an unclosed section, for messages."""
        if section.keyword in ("", HEAD):
            return "the definition"
        [place] = self._text.locate([section.start])
        return f"({section.keyword} of line {place.line}"

    def _begin(self, start: int, keyword: str) -> Section:
        section = Section(self._text, keyword, start, start)
        if keyword == HEAD:
            self._forms.append(Form(section))
        else:
            # A section before any form is within foreign text, which is not closed.
            self._forms[-1].add(section)
        return section

    def _check_head(self, form: Form) -> None:
        cursor = Cursor(self._diagnostics, form.head)
        cursor.at = 3
        kind = cursor.word("domain or problem").lower()
        if kind not in (DOMAIN, PROBLEM):
            cursor.fail("domain or problem", at=3)
        cursor.declared_name(kind)
        cursor.expect(")", f"')' after the name of the {kind}")
        cursor.nesting = form.nesting
        finish(cursor)


def finish(cursor: Cursor) -> None:
    """Check that a section ends at the cursor."""
    expected = "a section such as (:action ...), or ')' that closes the definition"
    if cursor.section.last:
        cursor.expect(")", expected)
        nesting, cursor.nesting = cursor.nesting, ""
        skip_foreign(cursor)
        cursor.nesting = nesting
    elif cursor.tokens[cursor.at]:
        cursor.fail(expected)


def skip_foreign(cursor: Cursor) -> None:
    """Skip the text outside of definitions, with warnings."""
    while cursor.tokens[cursor.at]:
        if cursor.tokens[cursor.at] == ")":
            cursor.deviate("the end of the text", "left out", "')' that closes nothing")
        elif cursor.tokens[cursor.at] == "(":
            cursor.deviate("(define", "left out")
        else:
            cursor.fail("(define")
        cursor.skip()


def check_sections(diagnostics: Diagnostics, form: Form) -> None:
    """Check the sections of a domain or a problem, and their order."""
    order, structures = (DOMAIN_ORDER, STRUCTURES) if form.kind == DOMAIN else (PROBLEM_ORDER, ())
    known = {keyword: rank for rank, keyword in enumerate(order)}
    known |= dict.fromkeys(structures, len(order))
    highest, behind = 0, ""
    seen: set[str] = set()
    for section in form.sections:
        if section.keyword not in known:
            _rename(diagnostics, form, section, list(known))
        keyword = section.keyword
        expected, read_as = "", ""
        if keyword in seen:
            expected, read_as = f"({keyword} ...) once", "read as one"
        elif known[keyword] < highest:
            expected, read_as = f"it before ({behind} ...)", "read all the same"
        elif keyword not in structures:
            seen.add(keyword)
        if known[keyword] > highest:
            highest, behind = known[keyword], keyword
        if expected:
            diagnostics.deviate(section, 0, f"'({keyword}'", expected, read_as, form.nesting)


def _rename(diagnostics: Diagnostics, form: Form, section: Section, known: list[str]) -> None:
    """Rename a section with an alias, with a warning; refuse an unknown one."""
    keyword = section.keyword
    alias = _ALIASES.get(keyword)
    if alias is not None:
        diagnostics.deviate(section, 0, f"'({keyword}'", f"'({alias}'", "read so", form.nesting)
        section.keyword = alias
        return
    origin = _FOREIGN.get(keyword)
    found = f"'({keyword}'{f', which is of {origin}' if origin else ''}"
    expected = f"a section of a {form.kind}{hint(keyword, known)}"
    diagnostics.refuse(section, 0, found, expected, form.nesting)
