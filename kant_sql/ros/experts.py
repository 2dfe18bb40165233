"""The services of PlanSys2's domain expert, problem expert and planner, on a knowledge base.

Names, messages and answers are those of PlanSys2 (ros2_planning_system). If its messages cannot
express something, such as a preference, the answer is an error that names it. A request that
changes nothing writes no revision.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain
from typing import Any

from .. import planning
from ..dto import PddlObjectDto
from ..dto.formulas import AT_START, And, Formula, Number, Timed, TypedName
from ..dto.lexical import ROOT_TYPE, fold
from ..errors import ConflictError, InvalidKnowledgeError, UnknownNameError
from ..knowledge_base import KnowledgeBase
from ..pddl import Action, Domain, Function, Predicate, read_domain, read_problem
from ..pddl.lexer import STRING, Text
from .node_trees import FUNCTION, PREDICATE, Messages, Scope, read_node, read_tree, write_tree
from .service import Service

# The maximum seconds of the planner, as in PlanSys2.
LONGEST = 15.0
# Seconds from one step to the next in a plan without times, as POPF writes it: PlanSys2's executor
# takes steps of one time as simultaneous.
STEP = 0.001

# Texts in messages are PDDL, and never paths.
_pddl = partial(Text, STRING)

# The function of a service, with its name, its interface, and the response field that it fills.
_Rows = Mapping[str, Callable[[Any], object]]


def _services(begin: str, kinds: Any, rows: _Rows) -> Iterator[Service]:
    for key, value in rows.items():
        name, kind, *fields = key.split(" ")
        yield Service(begin + name, getattr(kinds, kind), partial(_fill, fields, value))


def _fill(fields: list[str], value: Callable[[Any], object], request: Any, response: Any) -> None:
    found = value(request)
    for field in fields:
        setattr(response, field, found)


def messages_of(domain: Domain, made: Any) -> Messages:
    """Return how messages of a domain's formulas are made; `made` is `plansys2_msgs.msg`."""
    children: defaultdict[str, list[str]] = defaultdict(list)
    for each in domain.types:
        for parent in each.types:
            children[fold(parent)].append(each.name)

    def below(name: str) -> list[str]:
        found = chain.from_iterable((each, *below(each)) for each in children.get(fold(name), ()))
        return list(dict.fromkeys(found))

    signature = {
        fold(each.name): [parameter.types for parameter in each.parameters]
        for each in chain[Predicate | Function](domain.predicates, domain.functions)
    }
    return Messages(made, signature, {name: below(name) for name in children})


class DomainExpert:
    """Answers for `domain_expert/...`."""

    def __init__(self, kb: KnowledgeBase, made: Any) -> None:
        self._kb, self._made = kb, made

    def services(self, kinds: Any) -> Iterator[Service]:
        """Yield the services; `kinds` is `plansys2_msgs.srv`."""
        kb, names, details = self._kb, self._names, self._details
        action = partial(self._action, "action", self._made.Action)
        durative = partial(self._action, "durative_action", self._made.DurativeAction)
        rows: _Rows = {
            " GetDomain domain": lambda _: kb.domain_pddl(),
            "_name GetDomainName name": lambda _: kb.pddl.domain().name,
            "_types GetDomainTypes types": lambda _: list(
                dict.fromkeys([ROOT_TYPE, *(each.name for each in kb.pddl.domain().types)])
            ),
            # PlanSys2's own client leaves the type out.
            "_constants GetDomainConstants constants": lambda asked: [
                each.name
                for each in kb.objects.get_by_type(asked.type or ROOT_TYPE)
                if each.is_constant
            ],
            "_predicates GetStates states": partial(names, PREDICATE, "predicates"),
            "_predicate_details GetNodeDetails node": partial(details, PREDICATE, "predicates"),
            "_functions GetStates states": partial(names, FUNCTION, "functions"),
            "_function_details GetNodeDetails node": partial(details, FUNCTION, "functions"),
            "_derived_predicates GetStates states": partial(names, PREDICATE, "derived"),
            "_derived_predicate_details GetDomainDerivedPredicateDetails predicates": self._rules,
            "_actions GetDomainActions actions": partial(self._actions, "action"),
            "_action_details GetDomainActionDetails action": action,
            "_durative_actions GetDomainActions actions": partial(self._actions, "durative-action"),
            "_durative_action_details GetDomainDurativeActionDetails durative_action": durative,
        }
        return _services("domain_expert/get_domain", kinds, rows)

    def _names(self, node_type: int, section: str, _: Any) -> list[Any]:
        found = getattr(self._kb.pddl.domain(), section)
        names = [each.predicate if section == "derived" else each.name for each in found]
        return [self._made.Node(node_type=node_type, name=each) for each in names]

    def _details(self, node_type: int, section: str, request: Any) -> Any:
        domain = self._kb.pddl.domain()
        found = _find(getattr(domain, section), request.expression, section)
        parameters = _parameters(found.parameters, messages_of(domain, self._made))
        return self._made.Node(node_type=node_type, name=found.name, parameters=parameters)

    def _rules(self, request: Any) -> list[Any]:
        domain, made, found = self._kb.pddl.domain(), self._made, []
        messages = messages_of(domain, made)
        for rule in domain.derived:
            if fold(rule.predicate) == fold(request.predicate):
                parameters = _parameters(rule.variables, messages)
                node = made.Node(node_type=PREDICATE, name=rule.predicate, parameters=parameters)
                tree = write_tree(rule.formula, messages, _scope(rule.variables))
                found.append(made.Derived(predicate=node, preconditions=made.Tree(nodes=tree)))
        if not found:
            raise UnknownNameError(f"there is no {request.predicate!r} in the derived predicates")
        return found

    def _actions(self, kind: str, _: Any) -> list[str]:
        return [each.name for each in self._kb.pddl.domain().actions if each.kind == kind]

    def _action(self, field: str, make: Callable[..., Any], request: Any) -> Any:
        domain, kind, given = self._kb.pddl.domain(), field.replace("_", "-"), request.parameters
        chosen = [each for each in domain.actions if each.kind == kind]
        action = _find(chosen, getattr(request, field), f"{kind}s")
        messages, typed = messages_of(domain, self._made), action.parameters
        scope = _scope(typed, given)
        trees = {
            part: self._made.Tree(nodes=_nodes(formulas, messages, scope, part.endswith("effects")))
            for part, formulas in _parts(action).items()
        }
        parameters = _parameters(typed, messages, [term for _, term in scope])
        return make(name=action.name, parameters=parameters, **trees)


def _scope(typed: Sequence[TypedName], given: Sequence[str] = ()) -> Scope:
    """Name parameters as given, and the others by their position."""
    terms = [*given, *(f"?{index}" for index in range(len(given), len(typed)))]
    return tuple((fold(each.name), term) for each, term in zip(typed, terms, strict=False))


def _parts(action: Action) -> Mapping[str, Sequence[Formula]]:
    """Return the conjuncts of each tree of an action's message, by its field."""
    if action.kind == "action":
        return {"preconditions": action.condition, "effects": action.effect}
    found: defaultdict[str, list[Formula]] = defaultdict(list)
    for what, parts in (("requirements", action.condition), ("effects", action.effect)):
        for part in parts:
            # The writer refuses parts without a time, such as a preference.
            time = getattr(part, "time", AT_START).replace(" ", "_")
            found[f"{time}_{what}"].append(part.formula if isinstance(part, Timed) else part)
    return found


def _find(declared: Iterable[Any], name: str, what: str) -> Any:
    for each in declared:
        if fold(each.name) == fold(name):
            return each
    raise UnknownNameError(f"there is no {name!r} in the {what}")


def _parameters(
    typed: Sequence[TypedName], messages: Messages, terms: Sequence[str] = ()
) -> list[Any]:
    """Write parameters under given names, or as PlanSys2 names them, by type and place."""
    words = enumerate(each.type_text.strip("()").replace(" ", "_") for each in typed)
    names = terms or [f"?{word}{index}" for index, word in words]
    types = [each.types for each in typed]
    return [messages.make_param(*each, all_types=True) for each in zip(names, types, strict=True)]


def _nodes(
    parts: Iterable[Formula], messages: Messages, scope: Scope = (), is_effect: bool = False
) -> Any:
    """Write a conjunction of formulas as the nodes of a tree; without formulas, no node."""
    flat = [one for each in parts for one in (each.formulas if isinstance(each, And) else (each,))]
    return write_tree(And(tuple(flat)), messages, scope, is_effect=is_effect) if flat else []


class ProblemExpert:
    """Answers for `problem_expert/...`."""

    def __init__(self, kb: KnowledgeBase, made: Any) -> None:
        self._kb, self._made = kb, made

    def services(self, kinds: Any) -> Iterator[Service]:
        """Yield the services; `kinds` is `plansys2_msgs.srv`."""
        kb, facts, values = self._kb, self._kb.propositions, self._kb.function_values
        rows: _Rows = {
            "add_problem AddProblem": self._add_problem,
            "add_problem_goal AddProblemGoal": self._set_goal,
            "add_problem_instance AffectParam": self._add_instance,
            "add_problem_predicate AffectNode": lambda it: facts.save(read_node(it.node)),
            "add_problem_function AffectNode": lambda it: values.save(_value(it.node)),
            "update_problem_function AffectNode": self._update_function,
            "get_problem GetProblem problem": lambda _: kb.problem_pddl(),
            "get_problem_goal GetProblemGoal tree": self._goal,
            "get_problem_instance GetProblemInstanceDetails instance": self._instance,
            "get_problem_instances GetProblemInstances instances": self.instances,
            "get_problem_predicate GetNodeDetails node": self._predicate,
            "get_problem_predicates GetStates states": self._predicates,
            "get_problem_function GetNodeDetails node": self._function,
            "get_problem_functions GetStates states": self._functions,
            "is_problem_goal_satisfied IsProblemGoalSatisfied satisfied": (
                lambda it: kb.holds(read_tree(it.tree.nodes))
            ),
            "exist_problem_predicate ExistNode exist": lambda it: kb.holds(read_node(it.node)),
            "exist_problem_function ExistNode exist": (
                lambda it: values.get(read_node(it.node)) is not None
            ),
            "remove_problem_goal RemoveProblemGoal": lambda _: kb.goals.delete_all(),
            "remove_problem_instance AffectParam": self._remove_instance,
            "remove_problem_predicate AffectNode": lambda it: facts.delete(read_node(it.node)),
            "remove_problem_function AffectNode": lambda it: values.delete(read_node(it.node)),
            "clear_problem_knowledge ClearProblemKnowledge": self._clear,
        }
        return _services("problem_expert/", kinds, rows)

    def knowledge(self) -> Any:
        """Write the state as a `plansys2_msgs/msg/Knowledge`."""
        goals = self._kb.goals.get_all()
        return self._made.Knowledge(
            instances=[each.name for each in self.instances()],
            predicates=[read_node(each) for each in self._predicates()],
            functions=[read_node(each) for each in self._functions()],
            goal=str(And(tuple(goals))) if goals else "",
        )

    def _add_problem(self, request: Any) -> None:
        kb, domain = self._kb, self._kb.pddl.domain()
        # As PlanSys2 reads it: its clients compare names letter by letter.
        problem = read_problem(_pddl(whole=fold(request.problem)), domain=domain)
        with kb.transaction():
            kb.goals.delete_all()
            for each in problem.objects:
                self._insert(f"{each.name} - {each.type_text}")
            kb.propositions.save_all(problem.facts)
            kb.function_values.save_all(f"(= {one} {value})" for one, value in problem.values)
            kb.goals.save_all(problem.goal)
            kb.pddl.initial_literals.save_all(problem.literals)
            kb.pddl.timed_initial_literals.save_all(problem.timed)
            kb.pddl.constraints.save_all(problem.constraints)
            if problem.metric is not None:
                kb.pddl.metric.set(problem.metric)

    def _clear(self, _: Any) -> None:
        # PlanSys2 gives each problem this name.
        name = self._kb.pddl.domain().name
        empty = f"(define (problem problem_1) (:domain {name}) (:init) (:goal (and)))"
        self._kb.load_problem(empty)

    def _goal(self, _: Any) -> Any:
        messages = messages_of(self._kb.pddl.domain(), self._made)
        return self._made.Tree(nodes=_nodes(self._kb.goals.get_all(), messages))

    def _set_goal(self, request: Any) -> None:
        if not request.tree.nodes:
            raise InvalidKnowledgeError("the goal is an empty tree; remove_problem_goal removes it")
        goal = read_tree(request.tree.nodes)
        with self._kb.transaction():
            self._kb.goals.delete_all()
            self._kb.goals.save(goal)

    def _add_instance(self, request: Any) -> None:
        name, type_name = request.param.name, request.param.type
        if fold(type_name) != ROOT_TYPE and self._kb.types.get(type_name) is None:
            raise UnknownNameError(f"there is no type {type_name!r} for instance {name!r}")
        self._insert(f"{name} - {type_name}")

    def _insert(self, text: str) -> None:
        if not self._kb.objects.insert(text):
            stored = self._stored(text.partition(" ")[0])
            if fold(str(stored)) != fold(text):
                raise ConflictError(f"{stored} exists already; it cannot be added as {text}")

    def _stored(self, name: str) -> PddlObjectDto:
        found = self._kb.objects.get(name)
        if found is None:
            raise UnknownNameError(f"there is no instance {name!r}")
        return found

    def _instance(self, request: Any) -> Any:
        return self._params([self._stored(request.instance)])[0]

    def instances(self, _: Any = None) -> list[Any]:
        """Write the objects of the problem, and its domain's constants, if it has objects."""
        found = self._kb.objects.get_all()
        # As in PlanSys2, which knows constants from the first problem on.
        return [] if all(each.is_constant for each in found) else self._params(found)

    def _params(self, objects: Iterable[PddlObjectDto]) -> list[Any]:
        return [self._made.Param(name=each.name, type=each.type.name) for each in objects]

    def _remove_instance(self, request: Any) -> None:
        stored = self._stored(request.param.name)
        if stored.is_constant:
            # That would also delete its actions.
            raise InvalidKnowledgeError(f"{stored} is a constant; only the domain can leave it out")
        self._kb.objects.delete(stored)

    def _update_function(self, request: Any) -> None:
        if not self._kb.function_values.update(_value(request.node)):
            fluent = read_node(request.node)
            raise UnknownNameError(f"{fluent} has no value yet; add_problem_function sets one")

    def _predicate(self, request: Any) -> Any:
        if not self._kb.holds(request.expression):
            raise UnknownNameError(f"{request.expression} does not hold")
        return self._ground(PREDICATE, request.expression)

    def _function(self, request: Any) -> Any:
        value = self._kb.function_values.get(request.expression)
        if value is None or isinstance(value, PddlObjectDto):
            raise UnknownNameError(f"{request.expression} has no number, but {value}")
        return self._ground(FUNCTION, request.expression, float(value))

    def _ground(self, node_type: int, expression: str, value: float = 0.0) -> Any:
        name, *terms = expression.strip("() \t\n").split()
        parameters = self._params(map(self._stored, terms))
        return self._made.Node(node_type=node_type, name=name, parameters=parameters, value=value)

    def _predicates(self, _: Any = None) -> list[Any]:
        kb, made, node = self._kb, self._made, partial(self._made.Node, node_type=PREDICATE)
        facts = kb.propositions.get_all()
        found = [
            node(name=one.predicate.name, parameters=self._params(one.objects)) for one in facts
        ]
        for rule in {fold(one.predicate): one for one in kb.pddl.domain().derived}.values():
            variables = [f"?a{index}" for index in range(len(rule.variables))]
            for terms in kb.query(f"({' '.join([rule.predicate, *variables])})"):
                parameters = [made.Param(name=term) for term in terms]
                found.append(node(name=rule.predicate, parameters=parameters))
        return found

    def _functions(self, _: Any = None) -> list[Any]:
        found = []
        for one in self._kb.function_values.get_all():
            # A node has a number, and no object.
            if not isinstance(one.value, PddlObjectDto):
                node = self._made.Node(node_type=FUNCTION, name=one.function.name)
                node.parameters, node.value = self._params(one.objects), float(one.value)
                found.append(node)
        return found


def _value(node: Any) -> str:
    return f"(= {read_node(node)} {Number(node.value)})"


def planner_services(made: Any, kinds: Any) -> Iterator[Service]:
    """Yield `planner/...`; `made` and `kinds` are `plansys2_msgs.msg` and `.srv`."""
    rows: _Rows = {
        "validate_domain ValidateDomain": lambda asked: read_domain(_pddl(whole=asked.domain)),
        "get_plan GetPlan plan": partial(_plan, made),
    }
    return _services("planner/", kinds, rows)


def _plan(made: Any, request: Any) -> Any:
    domain = read_domain(_pddl(whole=request.domain))
    problem = read_problem(_pddl(whole=request.problem), domain=domain)
    items: list[Any] = []
    for step in planning.solve(domain, problem=problem, timeout=LONGEST).steps:
        start = len(items) * STEP if step.start is None else float(step.start)
        action = f"({' '.join((step.action, *step.arguments))})"
        items.append(made.PlanItem(time=start, action=action, duration=float(step.duration or 0)))
    return made.Plan(items=items)
