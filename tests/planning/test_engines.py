"""Planners that are programs, several at once: valid answers return, and nothing stays behind."""

from __future__ import annotations

import asyncio
import gc
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import kant_sql
from kant_sql import InvalidArgumentError, KnowledgeBase, NoPlanError, aio
from kant_sql.errors import PlannerMissingError, QuestionCancelledError
from kant_sql.planning import Plan
from kant_sql.planning.commands import configured, engines_file
from tests.planning.conftest import mentioning
from tests.support.processes.workers import wait_for

DOMAIN = """
(define (domain walk) (:types wp)
  (:predicates (at ?w - wp) (path ?a ?b - wp))
  (:action Walk :parameters (?a ?b - wp)
    :precondition (and (at ?a) (path ?a ?b)) :effect (and (not (at ?a)) (at ?b))))
"""
PROBLEM = """
(define (problem errand) (:domain walk) (:objects A b c - wp)
  (:init (at A) (path A b) (path b c) (path A c)) (:goal (at c)))
"""
LONG, SHORT = "(walk a b)\n(walk b c)\n", "(walk a c)\n"
# Each is a program: its arguments are the domain, the problem, the plan, and a file that it makes
# when it hangs.
FAKES = {
    "valid": f"open(plan, 'w').write({SHORT!r})",
    "long": f"open(plan, 'w').write({LONG!r})",
    "prints": f"print({SHORT!r})",
    "numbered": f"open(plan + '.1', 'w').write({LONG!r}); open(plan + '.2', 'w').write({SHORT!r})",
    "cut": f"open(plan + '.9', 'w').write({LONG!r}); open(plan + '.10', 'w').write('(walk a')",
    "removes": f"import shutil; shutil.rmtree(os.getcwd()); print({SHORT!r})",
    "pipes": f"os.mkfifo(plan); open(plan + '.1', 'w').truncate(1 << 30); print({SHORT!r})",
    "improves": f"open(plan + '.1', 'w').write({SHORT!r}); hang()",
    "invalid": "open(plan, 'w').write('(walk b c)\\n')",
    "unknown": "open(plan, 'w').write('(fly a c)\\n')",
    "nonsense": "sys.stdout.buffer.write(bytes(range(256)) * 99); print('\\nno idea')",
    "silent": "pass",
    "refuses": "print('problem proven unsolvable')",
    "crash": "os.kill(os.getpid(), signal.SIGSEGV)",
    "fails": "sys.exit('no licence')",
    "memory": "x = bytearray(4 << 30)",
    "endless": "while True: print('x' * 9999)",
    "hang": "hang()",
    "forks": "[os.fork() for _ in range(3)]; hang()",
    "escapes": "os.fork() or (os.setsid(), os.fork() and os._exit(0)); hang()",
    "leaves": f"open(plan, 'w').write({SHORT!r})\nif not os.fork(): os.setsid(); hang()\nwait()",
}
BODY = """
import os, signal, sys, time
domain, problem, plan, sign = sys.argv[1:]
def hang():
    with open(sign, 'a') as file: file.write('hangs ')
    while True: signal.pause()
def wait():
    while not os.path.exists(sign): time.sleep(0.01)
assert 'domain walk' in open(domain).read() and 'problem errand' in open(problem).read()
"""

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="planners run under POSIX")


@pytest.fixture
def kb() -> Iterator[KnowledgeBase]:
    with kant_sql.connect("sqlite://") as made:
        made.load_domain(DOMAIN)
        made.load_problem(PROBLEM)
        yield made


@pytest.fixture
def fake(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], str]:
    """Make the command line of a planner, and have all files of planners in a folder."""
    (tmp_path / "run").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "run"))

    def make(name: str) -> str:
        program = tmp_path / f"{name}.py"
        program.write_text(BODY + FAKES[name])
        return (
            f"{name}: '{sys.executable}' {program} {{domain}} {{problem}} {{plan}} {sign(tmp_path)}"
        )

    return make


def sign(folder: Path) -> Path:
    return folder / "hangs"


def nothing_stays(folder: Path) -> None:
    """Check that no process has a planner's program among its arguments, and no file is left."""
    assert not mentioning(folder)
    assert not list((folder / "run").iterdir())


@pytest.mark.parametrize("name", ["valid", "prints", "numbered", "long", "cut", "removes", "pipes"])
def test_a_command_answers(
    name: str, kb: KnowledgeBase, fake: Callable[[str], str], tmp_path: Path
) -> None:
    plan = kb.plan(fake(name))
    steps = ["(Walk A b)", "(Walk b c)"] if name in ("long", "cut") else ["(Walk A c)"]
    assert [str(step) for step in plan.steps] == steps
    assert (plan.engine, plan.status, plan.revision) == (name, "solved_satisficing", kb.revision)
    assert kb.plans.record(plan).planner == name
    nothing_stays(tmp_path)


FAILURES = {
    "invalid": ("invalid_plan", "an invalid plan: step 0, (Walk b c), fails at 1: (at b)"),
    "unknown": ("invalid_plan", "fly"),
    "nonsense": ("internal_error", "it ended with code 0, and said: no idea"),
    "silent": ("internal_error", "it ended with code 0"),
    "refuses": ("unsolvable_incompletely", "problem proven unsolvable"),
    "crash": ("internal_error", f"signal {signal.SIGSEGV:d} ended it"),
    "fails": ("internal_error", "code 1, and said: no licence"),
    "endless": ("internal_error", "it printed more than 16 MiB"),
    "memory": ("memout", "MemoryError"),
}


@pytest.mark.parametrize("name", FAILURES)
def test_what_is_wrong_with_a_planner_is_said(
    name: str, kb: KnowledgeBase, fake: Callable[[str], str], tmp_path: Path
) -> None:
    status, said = FAILURES[name]
    with pytest.raises(NoPlanError) as caught:
        kb.plan(fake(name), memory=1000)
    (run,) = caught.value.runs
    assert (run.engine, run.status) == (name, status) == (name, caught.value.status)
    for text in (run.said, str(caught.value)):
        assert name in text
        assert said in text
    nothing_stays(tmp_path)


@pytest.mark.parametrize("name", ["hang", "forks", "escapes"])
def test_a_planner_that_hangs_ends_with_its_time(
    name: str, kb: KnowledgeBase, fake: Callable[[str], str], tmp_path: Path
) -> None:
    with pytest.raises(NoPlanError, match=f"{name}: no plan was found within 2 sec") as caught:
        kb.plan(fake(name), timeout=2)
    assert [run.status for run in caught.value.runs] == ["timeout"]
    nothing_stays(tmp_path)


def test_what_a_planner_leaves_running_ends_with_it(
    kb: KnowledgeBase, fake: Callable[[str], str], tmp_path: Path
) -> None:
    assert kb.plan(fake("leaves")).engine == "leaves"
    assert sign(tmp_path).exists()
    nothing_stays(tmp_path)


def test_the_first_valid_answer_ends_the_others(
    kb: KnowledgeBase, fake: Callable[[str], str], tmp_path: Path
) -> None:
    names = ["forks", "invalid", "leaves", "fails"]
    plan = kb.plan(engines=[fake(name) for name in names])
    assert plan.engine == "leaves"
    assert [run.engine for run in plan.runs] == names
    assert [plan.runs[n].status for n in (0, 2)] == ["stopped", "solved_satisficing"]
    assert all(run.seconds > 0 and run.said for run in plan.runs)
    # Whoever is slow is stopped before it says what is wrong.
    assert plan.runs[1].status in ("invalid_plan", "stopped")
    recorded = kb.plans.record(plan)
    assert recorded.planner == "leaves"
    assert recorded.status is not None
    assert recorded.status.startswith("solved_satisficing; forks: stopped in ")
    nothing_stays(tmp_path)


def test_the_best_answer_until_the_time_is_up(
    kb: KnowledgeBase, fake: Callable[[str], str], tmp_path: Path
) -> None:
    plan = kb.plan(engines=map(fake, ["long", "improves"]), keep="best", timeout=8)
    assert [(run.engine, run.status) for run in plan.runs] == [
        ("long", "solved_satisficing"),
        ("improves", "solved_satisficing"),
    ]
    assert (plan.engine, len(plan.steps)) == ("improves", 1)
    nothing_stays(tmp_path)


def test_all_failures_are_said(kb: KnowledgeBase, fake: Callable[[str], str]) -> None:
    engines = [*map(fake, ["crash", "refuses"]), "absent: no-such-program {domain} {problem}"]
    with pytest.raises(NoPlanError, match=r"no engine found a plan \(crash: internal_") as caught:
        kb.plan(engines=engines)
    statuses = ["internal_error", "unsolvable_incompletely", "missing"]
    assert [run.status for run in caught.value.runs] == statuses
    assert caught.value.status == "unsolvable_incompletely"


def test_a_question_that_is_cancelled_ends_its_planners(
    kb: KnowledgeBase, fake: Callable[[str], str], tmp_path: Path
) -> None:
    def cancel(limit: kant_sql.limits.Limit) -> None:
        wait_for(sign(tmp_path).exists)
        limit.cancel()

    with kant_sql.limited() as limit:
        thread = threading.Thread(target=cancel, args=(limit,))
        thread.start()
        with pytest.raises(QuestionCancelledError):
            kb.plan(engines=[fake("forks"), fake("hang")])
        thread.join()
    nothing_stays(tmp_path)


def test_a_keyboard_interrupt_ends_the_planners(
    kb: KnowledgeBase, fake: Callable[[str], str], tmp_path: Path
) -> None:
    def interrupt() -> None:
        wait_for(sign(tmp_path).exists)
        os.kill(os.getpid(), signal.SIGINT)

    # What runs in the background may have been started to ignore it.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    thread = threading.Thread(target=interrupt)
    thread.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            kb.plan(engines=[fake("escapes"), fake("hang")])
    finally:
        signal.signal(signal.SIGINT, before)
    thread.join()
    nothing_stays(tmp_path)


def test_a_task_that_is_cancelled_ends_its_planners(
    fake: Callable[[str], str], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def work() -> None:
        async with aio.connect("sqlite://") as kb:
            await kb.load_domain(DOMAIN)
            await kb.load_problem(PROBLEM)
            assert (await kb.plan(fake("valid"))).engine == "valid"
            task = asyncio.create_task(kb.plan(fake("forks")))
            await asyncio.to_thread(wait_for, sign(tmp_path).exists)
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
            nothing_stays(tmp_path)

    asyncio.run(work())
    # A future whose error nobody reads says so when it goes.
    gc.collect()
    assert not [one for one in caplog.records if one.name == "asyncio"]


def test_engines_have_names_in_a_file(
    kb: KnowledgeBase, fake: Callable[[str], str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "engines.toml"
    monkeypatch.setenv("KANT_SQL_ENGINES", str(file))
    with pytest.raises(InvalidArgumentError, match=r"engines.toml cannot be read"):
        kb.plan("walker")
    line = fake("valid").partition(": ")[2]
    file.write_text(f'[engines]\nwalker = """{line}"""\n')
    assert kb.plan("walker").engine == "walker"
    file.write_text("[engines]\nwalker = 3\n")
    with pytest.raises(InvalidArgumentError, match=r"engines.walker in .* is 3; write a comm"):
        kb.plan("walker")
    file.write_text(f'[engine]\nwalker = """{line}"""\n')
    with pytest.raises(InvalidArgumentError, match=r"engines in .* is None; write a command line"):
        kb.plan("walker")
    monkeypatch.setenv("KANT_SQL_ENGINES", "")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert configured(engines_file()) == {}
    (tmp_path / "kant_sql").mkdir()
    (tmp_path / "kant_sql" / "engines.toml").write_text(f'[engines]\nwalker = """{line}"""\n')
    assert kb.plan("walker").engine == "walker"


@pytest.mark.parametrize(
    ("engine", "error", "said"),
    [
        ("x: planner {domain}", InvalidArgumentError, "where the planner takes the problem"),
        ("x: planner 'a {domain} {problem}", InvalidArgumentError, "not a command line"),
        ("no-such-program {domain} {problem}", PlannerMissingError, "there is no program"),
    ],
)
def test_command_lines_that_are_none(
    engine: str, error: type[Exception], said: str, kb: KnowledgeBase
) -> None:
    with pytest.raises(error, match=said):
        kb.plan(engine)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"engine": "a", "engines": ["b"]}, "engine or engines"),
        ({"engines": []}, "engines is empty"),
        ({"engines": "lama"}, "engines"),
        ({"engines": ["a"], "keep": "all"}, "keep"),
        ({"memory": 0}, "memory"),
    ],
)
def test_arguments_that_make_no_sense(
    words: dict[str, object], said: str, kb: KnowledgeBase
) -> None:
    with pytest.raises(InvalidArgumentError, match=said):
        kb.plan(**words)  # type: ignore[arg-type]


def test_no_shell_reads_a_command_line(
    kb: KnowledgeBase, fake: Callable[[str], str], tmp_path: Path
) -> None:
    with pytest.raises(NoPlanError):
        kb.plan(f"x: echo {{domain}} {{problem}} ; touch {tmp_path}/made $(touch {tmp_path}/made)")
    assert not (tmp_path / "made").exists()


DERIVED = """
(define (domain reach) (:types wp)
  (:predicates (at ?w - wp) (path ?a ?b - wp) (reaches ?a ?b - wp) (lit ?w - wp))
  (:derived (reaches ?a ?b - wp)
    (or (path ?a ?b) (exists (?x - wp) (and (path ?a ?x) (reaches ?x ?b)))))
  (:action shine :parameters (?a ?b - wp)
    :precondition (and (at ?a) (reaches ?a ?b)) :effect (lit ?b)))
"""


def test_fast_downward_reads_what_unified_planning_cannot_express(kb: KnowledgeBase) -> None:
    pytest.importorskip("up_fast_downward", reason="needs the extra planning")
    kb.load_domain(DERIVED)
    kb.load_problem(PROBLEM.replace("walk", "reach").replace("(at c)", "(lit c)"))
    plan = kb.plan(timeout=60)
    assert (plan.engine, str(plan)) == ("fast-downward", "(shine A c)\n")
    assert Plan.read(str(plan)).steps == plan.steps


def test_a_planner_waits_for_no_module_that_it_does_not_need() -> None:
    pytest.importorskip("unified_planning")
    code = """
import subprocess
import sys
from kant_sql.planning import worker
worker._spare_imports()
engines = worker.Engines()
assert engines.find("pyperplan").is_oneshot_planner()
assert not {"scipy", "networkx.algorithms", "pyparsing", "grpc", "up_enhsp"} & {*sys.modules}
assert engines.find("oversubscription[fast-downward]") and not engines.find("replanner[hal9000]")
assert {"pyperplan", "oversubscription[fast-downward]"} <= {*engines.planners()}
import unified_planning as up
from unified_planning.io import PDDLReader, PDDLWriter
problem = up.model.Problem("none")
for writer in up.io.PDDLWriter, PDDLWriter:
    assert PDDLReader().parse_problem_string(writer(problem).get_domain()).fluents == []
from unified_planning.io.pddl_writer import PDDLWriter as Same
assert isinstance(PDDLWriter(problem), Same)
from unified_planning.shortcuts import InstantaneousAction
from ConfigSpace import ConfigurationSpace
assert "scipy" not in sys.modules
from unified_planning.plans import ActionInstance, PartialOrderPlan, PlanKind
first, last = (ActionInstance(InstantaneousAction(name)) for name in "ba")
ordered = PartialOrderPlan({first: [last]})
assert ordered.convert_to(PlanKind.SEQUENTIAL_PLAN, None).actions == [first, last]
import ConfigSpace.hyperparameters
from ConfigSpace import Float
import ConfigSpace
assert ConfigSpace.ConfigurationSpace({"x": (1, 2)})["x"].upper == 2
"""
    subprocess.run([sys.executable, "-c", code], check=True)
