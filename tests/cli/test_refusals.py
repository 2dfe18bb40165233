"""What a command of the past refuses is one line, with an exit code, and nothing else."""

from __future__ import annotations

import json
import shlex

import pytest

from tests.support.processes.commands import complaint, run

NO_MOMENT = "neither a revision's number nor a time"
STATES = "--at and its options show a state"
# On a store of the knowledge base tiago at revision 3: words, exit code, what the line says.
REFUSED = (
    ("dump --at 2999-01-01", 1, "future"),
    ("dump --at 7", 1, "has no revision 7"),
    ("dump --at soon", 2, NO_MOMENT),
    ("dump --kb nobody", 1, "choose one with --kb: 'tiago'"),
    *(
        (f"dump --at {at}", 1, f"--at {at} is before the first revision of knowledge base 'tiago'")
        for at in ("0", "2020-01-01")
    ),
    *((f"log --limit '{limit}'", 2, "--limit") for limit in ("-1", "x", "")),
    ("log --since 2999-01-01T00:00:00Z", 1, "the time 2999-01-01T00:00:00+00:00 is in the future"),
    ("log --element nosuch", 1, "knowledge base 'tiago' has never had an element 'nosuch'"),
    ("log --element robot_att", 1, "(did you mean robot_at?)"),
    ("log --element '(robot_at rb11 wp1)'", 1, "(did you mean rb1?)"),
    ("log --element '(robot_at rb1 rb1)'", 1, "it has never been there; see: kant-sql log"),
    ("log --actor nobody", 1, "knowledge base 'tiago' has no revision by actor 'nobody'"),
    ("log --actor perceptoin", 1, "(did you mean perception?)"),
    ("log --actor executive --element nosuch", 1, "'nosuch'"),
    ("diff 1..2 3", 2, "give A B or A..B, not both"),
    ("diff 1...2", 2, "'.2'"),
    ("diff 1 9", 1, "has no revision 9: it is at 3"),
    ("restore 9", 1, "has no revision 9: it is at 3"),
    ("blame wp9", 1, "knowledge base 'tiago' has never had an element 'wp9'"),
    ("blame '(robot_at rb1 rb1)'", 1, "it does not hold; see: kant-sql history"),
    ("history '(robot_at rb1 nowhere)'", 1, "has never had an object 'nowhere'"),
    ("history '(robot_at rb11 wp1)'", 1, "an object 'rb11' (did you mean rb1?)"),
    (
        "history '(robot_at rb1 rb1)'",
        1,
        "it has never been there; see: kant-sql log; for periods: kant-sql when --clock valid",
    ),
    *(
        (command + words, 2, "(or set KANT_SQL_URL) and")
        for command in ("diff", "history", "blame", "restore")
        for words in ("", " 1 2 3 4")
    ),
    ("show 4", 1, "has no revision 4: it is at 3"),
    ("show 0", 1, "there was no revision of knowledge base 'tiago' yet"),
    ("show 2 --at 1", 2, STATES),
    ("show 2 --facts", 2, STATES),
    ("show 2 3", 2, "[REV|TIME]"),
    ("show --at 4", 1, "has no revision 4: it is at 3"),
    ("show --at -1", 1, "has no revision -1"),
    (f"show --at {'9' * 30}", 1, "has no revision 999"),
    ("show --at 9998-12-31", 1, "is in the future"),
    *(
        (f"show --at '{at}'", 2, NO_MOMENT)
        for at in ("9" * 5000, "soon", "", "2026-02-30", "0001-01-01T00:00+14:00")
    ),
    ("show --predicate robot_att", 1, "no predicate 'robot_att'"),
    ("show --predicate robot_att", 1, "(did you mean robot_at?)"),
    ("show --object rb11", 1, "(did you mean rb1?)"),
    ("show --type robto", 1, "(did you mean robot?)"),
    ("show --type drone --at 1", 1, "no type 'drone'"),
    ("show --type robot --object nosuch", 1, "no object 'nosuch'"),
    ("plan --timeout -1", 2, "--timeout"),
    ("plan --timeout soon", 2, "--timeout"),
    ("plan --at soon", 2, "--at"),
    ("plan --actor operator", 2, "--record"),
    ("plan --reason why", 2, "--record"),
    ("plan --read plan.txt --timeout 0", 2, "do not go with --read"),
    ("rules '(always (robot_at rb1 wp1))' --refuse", 2, "needs --save"),
    ("rules --kept --actor operator", 2, "--actor: needs --save or --delete"),
    ("unconfirmed --contradicted --older-than 3", 2, "does not go with --contradicted"),
    ("corrections --since soon", 2, NO_MOMENT),
    ("plans first", 2, "'first': expected the number of one plan"),
    ("plans 7 --plan 7", 2, "'7': expected the number of one plan"),
    ("plans 7", 1, "there is no plan 7 in knowledge base 'tiago'"),
    ("plans --plan 77", 1, "there is no plan 77 in knowledge base 'tiago'"),
    ("verify --jobs 2", 2, "give --all with it"),
    ("verify --all --kb tiago", 2, "not both"),
    ("verify --all --jobs 0", 2, "--jobs"),
    ("verify --all --complete --complete-since yesterday", 2, "not with --complete"),
    ("verify --all --continue --complete-since yesterday", 2, "not with --continue"),
    ("verify --all --complete-since 7", 2, "expected a time"),
    ("verify --all --complete-since nonsense", 2, "--complete-since"),
    ("verify --anchor nowhere.json", 2, "nowhere.json"),
    ("watch --after 4", 1, "no revision 4"),
    ("watch --after -1", 2, "--after"),
    ("watch --after now", 2, "--after"),
    *((f"watch --timeout {seconds}", 2, "--timeout") for seconds in ("-1", "nan", "soon")),
    ("watch --kb other", 1, "'tiago'"),
    ("export", 2, "--to"),
)


@pytest.mark.parametrize(("words", "code", "said"), REFUSED)
def test_what_is_refused_is_one_line(store: str, words: str, code: int, said: str) -> None:
    command, *rest = shlex.split(words)
    assert said in complaint(command, store, *rest, code=code)


@pytest.mark.parametrize("words", ["show", "log", "apply '(a)'", "kbs", "verify"])
def test_the_url_of_a_server_is_refused_by_name(words: str) -> None:
    command, *rest = shlex.split(words)
    said = complaint(command, "https://:geheim@localhost/tiago", *rest, code=1)
    assert "https: this needs the store itself" in said
    assert "there is only what kant_sql.connect(URL) opens" in said


def test_with_json_the_line_is_a_document(store: str) -> None:
    result = run("log", store, "--since", "2", "--json", "--actor", "nobody")
    assert "'nobody'" in json.loads(result.stderr)["error"]
    assert (result.exit_code, result.stdout) == (1, "")


@pytest.mark.parametrize(
    ("words", "kind"),
    [
        ("log --kb nobody", "UnknownNameError"),
        ("show --predicate robot_to", "UnknownNameError"),
        ("plans 7", "UnknownNameError"),
        ("history rb7", "UnknownNameError"),
        ("show 0", "UnknownRevisionError"),
    ],
)
def test_the_type_of_what_is_unknown_is_that_of_the_other_doors(
    store: str, words: str, kind: str
) -> None:
    command, *rest = shlex.split(words)
    assert json.loads(run(command, store, *rest, "--json").stderr)["type"] == kind
