"""The services of PlanSys2's domain expert, problem expert and planner, on a knowledge base.

Names, messages and answers are those of PlanSys2 (ros2_planning_system); what its messages cannot
hold, such as a preference, is answered with an error that says so. A service of PlanSys2 that
changes nothing, because what it asks for is so already, writes no revision here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import chain, zip_longest
from typing import Any

import kant_sql

from ..dto import PddlObjectDto, PddlPropositionDto, PddlTypeDto
from ..dto.formulas import (
    AT_END,
    AT_START,
    TIMES,
    And,
    Atom,
    Derived,
    Fluent,
    Formula,
    Timed,
    TypedName,
)
from ..dto.lexical import ROOT_TYPE, fold
from ..errors import InvalidKnowledgeError, UnknownNameError
from ..knowledge_base import KnowledgeBase
from ..pddl import Action, Domain, Function, Predicate, read_domain, read_problem
from .service import Service
from .trees import FUNCTION, PREDICATE, Messages, read_node, read_tree, write_tree

Answer = Callable[[Any, Any], None]


def messages_of(domain: Domain, made: Any) -> Messages:
    """Return how messages of a domain's formulas are made; `made` is `plansys2_msgs.msg`."""
    below: dict[str, list[str]] = {}
    above = {fold(each.name): [fold(one) for one in each.types] for each in domain.types}
    for name, types in above.items():
        todo, seen = list(types), {name}
        while todo:
            one = todo.pop()
            if one not in seen:
                seen.add(one)
                below.setdefault(one, []).append(name)
                todo.extend(above.get(one, ()))
    signature = {
        fold(each.name): [parameter.type_text for parameter in each.parameters]
        for each in chain[Predicate | Function](domain.predicates, domain.functions)
    }
    return Messages(made.Node, made.Param, signature, below)


class DomainExpert:
    """Answers for `domain_expert/...`."""

    def __init__(self, kb: KnowledgeBase, made: Any) -> None:
        self._kb = kb
        self._made = made

    def services(self, kinds: Any) -> Iterator[Service]:
        """Yield the services; `kinds` is `plansys2_msgs.srv`."""
        for name, kind, answer in (
            ("domain", "GetDomain", self._text),
            ("domain_name", "GetDomainName", self._name),
            ("domain_types", "GetDomainTypes", self._types),
            ("domain_constants", "GetDomainConstants", self._constants),
            ("domain_actions", "GetDomainActions", self._actions("action")),
            ("domain_durative_actions", "GetDomainActions", self._actions("durative-action")),
            ("domain_action_details", "GetDomainActionDetails", self._action),
            ("domain_durative_action_details", "GetDomainDurativeActionDetails", self._durative),
            ("domain_predicates", "GetStates", self._names("predicates", PREDICATE)),
            ("domain_functions", "GetStates", self._names("functions", FUNCTION)),
            ("domain_predicate_details", "GetNodeDetails", self._details("predicates", PREDICATE)),
            ("domain_function_details", "GetNodeDetails", self._details("functions", FUNCTION)),
            ("domain_derived_predicates", "GetStates", self._derived_names),
            ("domain_derived_predicate_details", "GetDomainDerivedPredicateDetails", self._derived),
        ):
            yield Service(f"domain_expert/get_{name}", getattr(kinds, kind), answer)

    def _text(self, _: Any, response: Any) -> None:
        response.domain = self._kb.domain_pddl()

    def _name(self, _: Any, response: Any) -> None:
        response.name = self._kb.pddl.domain().name

    def _types(self, _: Any, response: Any) -> None:
        found = [each.name for each in self._kb.pddl.domain().types]
        response.types = found if not found or ROOT_TYPE in found else [ROOT_TYPE, *found]

    def _constants(self, request: Any, response: Any) -> None:
        found = self._kb.objects.get_by_type(request.type)
        response.constants = [each.name for each in found if each.is_constant]

    def _actions(self, kind: str) -> Answer:
        def answer(_: Any, response: Any) -> None:
            actions = self._kb.pddl.domain().actions
            response.actions = [each.name for each in actions if each.kind == kind]

        return answer

    def _names(self, section: str, node_type: int) -> Answer:
        def answer(_: Any, response: Any) -> None:
            found = getattr(self._kb.pddl.domain(), section)
            response.states = [self._named(node_type, each.name) for each in found]

        return answer

    def _named(self, node_type: int, name: str) -> Any:
        return self._made.Node(node_type=node_type, name=name)

    def _details(self, section: str, node_type: int) -> Answer:
        def answer(request: Any, response: Any) -> None:
            domain = self._kb.pddl.domain()
            found = _find(getattr(domain, section), request.expression, section[:-1])
            messages = messages_of(domain, self._made)
            response.node = self._declared(node_type, found.name, found.parameters, messages)

        return answer

    def _declared(
        self, node_type: int, name: str, parameters: Iterable[TypedName], messages: Messages
    ) -> Any:
        node = self._named(node_type, name)
        node.parameters = [
            messages.make_param(f"?{each.type_text}{index}", each.type_text, all_types=True)
            for index, each in enumerate(parameters)
        ]
        return node

    def _derived_names(self, _: Any, response: Any) -> None:
        rules = self._kb.pddl.domain().derived
        response.states = [self._named(PREDICATE, each.predicate) for each in rules]

    def _derived(self, request: Any, response: Any) -> None:
        domain = self._kb.pddl.domain()
        messages = messages_of(domain, self._made)
        name = fold(request.predicate)
        rules = [each for each in domain.derived if fold(each.predicate) == name]
        if not rules:
            raise UnknownNameError(f"there is no derived predicate {request.predicate!r}")
        response.predicates = [self._rule(each, messages) for each in rules]

    def _rule(self, rule: Derived, messages: Messages) -> Any:
        names = {fold(each.name): f"?{index}" for index, each in enumerate(rule.variables)}
        node = self._declared(PREDICATE, rule.predicate, rule.variables, messages)
        return self._made.Derived(
            predicate=node, preconditions=self._tree((rule.formula,), messages, names)
        )

    def _tree(self, parts: Iterable[Formula], messages: Messages, names: dict[str, str]) -> Any:
        given = tuple(parts)
        if not given:
            return self._made.Tree()
        formula = given[0] if len(given) == 1 and isinstance(given[0], And) else And(given)
        return self._made.Tree(nodes=write_tree(formula, messages, names))

    def _action(self, request: Any, response: Any) -> None:
        domain = self._kb.pddl.domain()
        action = _find(domain.actions, request.action, "action", "action")
        made, messages, names = self._begun(self._made.Action, action, domain, request.parameters)
        made.preconditions = self._tree(action.condition, messages, names)
        made.effects = self._tree(action.effect, messages, names)
        response.action = made

    def _durative(self, request: Any, response: Any) -> None:
        domain = self._kb.pddl.domain()
        action = _find(domain.actions, request.durative_action, "action", "durative-action")
        kind = self._made.DurativeAction
        made, messages, names = self._begun(kind, action, domain, request.parameters)
        for field, parts, times in (
            ("requirements", action.condition, TIMES),
            ("effects", action.effect, (AT_START, AT_END)),
        ):
            timed = [_timed(action, each) for each in parts]
            for time in times:
                at_time = [each.formula for each in timed if each.time == time]
                tree = self._tree(at_time, messages, names)
                setattr(made, f"{time.replace(' ', '_')}_{field}", tree)
        response.durative_action = made

    def _begun(
        self, kind: Any, action: Action, domain: Domain, given: list[str]
    ) -> tuple[Any, Messages, dict[str, str]]:
        messages = messages_of(domain, self._made)
        shown = [*given, *(f"?{index}" for index in range(len(given), len(action.parameters)))]
        names = {
            fold(each.name): name for each, name in zip(action.parameters, shown, strict=False)
        }
        parameters = [
            messages.make_param(name, each.type_text, all_types=True)
            for each, name in zip(action.parameters, shown, strict=False)
        ]
        return kind(name=action.name, parameters=parameters), messages, names


def _timed(action: Action, part: Formula) -> Timed:
    if isinstance(part, Timed):
        return part
    raise InvalidKnowledgeError(
        f"{part} of action {action.name} has no form in PlanSys2's messages; "
        "ask for the domain as PDDL text"
    )


def _find(declared: Iterable[Any], name: str, what: str, kind: str | None = None) -> Any:
    for each in declared:
        if fold(each.name) == fold(name) and (kind is None or each.kind == kind):
            return each
    raise UnknownNameError(f"there is no {what} {name!r}")


class ProblemExpert:
    """Answers for `problem_expert/...`."""

    def __init__(self, kb: KnowledgeBase, made: Any) -> None:
        self._kb = kb
        self._made = made

    def services(self, kinds: Any) -> Iterator[Service]:
        """Yield the services; `kinds` is `plansys2_msgs.srv`."""
        for name, kind, answer in (
            ("add_problem", "AddProblem", self._add_problem),
            ("add_problem_goal", "AddProblemGoal", self._set_goal),
            ("add_problem_instance", "AffectParam", self._add_instance),
            ("add_problem_predicate", "AffectNode", self._add_predicate),
            ("add_problem_function", "AffectNode", self._set_function),
            ("get_problem", "GetProblem", self._text),
            ("get_problem_goal", "GetProblemGoal", self._goal),
            ("get_problem_instance", "GetProblemInstanceDetails", self._instance),
            ("get_problem_instances", "GetProblemInstances", self._instances),
            ("get_problem_predicate", "GetNodeDetails", self._predicate),
            ("get_problem_predicates", "GetStates", self._predicates),
            ("get_problem_function", "GetNodeDetails", self._function),
            ("get_problem_functions", "GetStates", self._functions),
            ("is_problem_goal_satisfied", "IsProblemGoalSatisfied", self._is_satisfied),
            ("remove_problem_goal", "RemoveProblemGoal", self._remove_goal),
            ("remove_problem_instance", "AffectParam", self._remove_instance),
            ("remove_problem_predicate", "AffectNode", self._remove_predicate),
            ("remove_problem_function", "AffectNode", self._remove_function),
            ("clear_problem_knowledge", "ClearProblemKnowledge", self._clear),
            ("exist_problem_predicate", "ExistNode", self._exists_predicate),
            ("exist_problem_function", "ExistNode", self._exists_function),
            ("update_problem_function", "AffectNode", self._update_function),
        ):
            yield Service(f"problem_expert/{name}", getattr(kinds, kind), answer)

    def knowledge(self) -> Any:
        """Write what holds as a `plansys2_msgs/msg/Knowledge`."""
        goals = self._kb.goals.get_all()
        return self._made.Knowledge(
            instances=[each.name for each in self._kb.objects.get_all()],
            predicates=[str(each) for each in self._kb.propositions.get_all()],
            functions=[str(each) for each in self._kb.function_values.get_all()],
            goal=str(And(tuple(goals))) if goals else "",
        )

    def _text(self, _: Any, response: Any) -> None:
        response.problem = self._kb.problem_pddl()

    def _add_problem(self, request: Any, _: Any) -> None:
        domain = self._kb.pddl.domain()
        # As PlanSys2 reads it: its clients compare names letter by letter.
        problem = read_problem(fold(request.problem), domain=domain)
        with self._kb.transaction():
            self._kb.goals.delete_all()
            known = {fold(each.name) for each in self._kb.objects.get_all()}
            for each in problem.objects:
                if fold(each.name) not in known:
                    self._kb.objects.save(PddlObjectDto(PddlTypeDto(each.type_text), each.name))
            self._kb.propositions.save_all(problem.facts)
            self._kb.function_values.save_all(f"(= {one} {value})" for one, value in problem.values)
            if problem.goal:
                self._kb.goals.save(list(problem.goal))

    def _goal(self, _: Any, response: Any) -> None:
        goals = tuple(self._kb.goals.get_all())
        if goals:
            messages = messages_of(self._kb.pddl.domain(), self._made)
            formula = And(goals)
            response.tree = self._made.Tree(nodes=write_tree(formula, messages))

    def _set_goal(self, request: Any, _: Any) -> None:
        if not request.tree.nodes:
            raise InvalidKnowledgeError("the goal is an empty tree; remove_problem_goal removes it")
        goal = read_tree(request.tree.nodes)
        with self._kb.transaction():
            self._kb.goals.delete_all()
            self._kb.goals.save(goal)

    def _remove_goal(self, _: Any, __: Any) -> None:
        self._kb.goals.delete_all()

    def _is_satisfied(self, request: Any, response: Any) -> None:
        response.satisfied = self._kb.holds(read_tree(request.tree.nodes))

    def _add_instance(self, request: Any, _: Any) -> None:
        name, type_name = request.param.name, request.param.type
        if fold(type_name) != ROOT_TYPE and self._kb.types.get(type_name) is None:
            raise UnknownNameError(f"there is no type {type_name!r} for instance {name!r}")
        dto = PddlObjectDto(PddlTypeDto(type_name), name)
        if not self._kb.objects.insert(dto):
            stored = self._kb.objects.get(name)
            if stored is not None and stored.type != dto.type:
                raise InvalidKnowledgeError(f"{stored} exists, with another type than {type_name}")

    def _instance(self, request: Any, response: Any) -> None:
        response.instance = self._param(_stored(self._kb.objects.get(request.instance), request))

    def _instances(self, _: Any, response: Any) -> None:
        response.instances = [self._param(each) for each in self._kb.objects.get_all()]

    def _param(self, dto: PddlObjectDto) -> Any:
        return self._made.Param(name=dto.name, type=dto.type.name)

    def _remove_instance(self, request: Any, _: Any) -> None:
        if not self._kb.objects.delete(request.param.name):
            raise UnknownNameError(f"there is no instance {request.param.name!r}")

    def _clear(self, _: Any, __: Any) -> None:
        with self._kb.transaction():
            self._kb.goals.delete_all()
            self._kb.propositions.delete_all(self._kb.propositions.get_all())
            self._kb.function_values.delete_all()
            objects = self._kb.objects.get_all()
            self._kb.objects.delete_all([each for each in objects if not each.is_constant])

    def _add_predicate(self, request: Any, _: Any) -> None:
        self._kb.propositions.save(_atom(request.node))

    def _remove_predicate(self, request: Any, _: Any) -> None:
        self._kb.propositions.delete(_atom(request.node))

    def _exists_predicate(self, request: Any, response: Any) -> None:
        response.exist = self._kb.holds(_atom(request.node))

    def _predicate(self, request: Any, response: Any) -> None:
        if not self._kb.holds(request.expression):
            raise UnknownNameError(f"{request.expression} does not hold")
        name, *terms = request.expression.strip().strip("()").split()
        response.node = self._node(PREDICATE, name, terms)

    def _node(self, kind: int, name: str, terms: Iterable[str], value: float = 0.0) -> Any:
        declared = (self._kb.predicates if kind == PREDICATE else self._kb.functions).get(name)
        types = [] if declared is None else [each.name for each in declared.types]
        parameters = [
            self._made.Param(name=each, type=type_)
            for each, type_ in zip_longest(terms, types, fillvalue="")
        ]
        return self._made.Node(node_type=kind, name=name, parameters=parameters, value=value)

    def _predicates(self, _: Any, response: Any) -> None:
        facts = [self._of_dto(each) for each in self._kb.propositions.get_all()]
        response.states = [*facts, *self._inferred()]

    def _of_dto(self, dto: PddlPropositionDto) -> Any:
        made = self._made
        parameters = [made.Param(name=each.name, type=each.type.name) for each in dto.objects]
        return made.Node(node_type=PREDICATE, name=dto.predicate.name, parameters=parameters)

    def _inferred(self) -> Iterator[Any]:
        for rule in {fold(one.predicate): one for one in self._kb.pddl.domain().derived}.values():
            variables = [f"?a{index}" for index in range(len(rule.variables))]
            for terms in self._kb.query(f"({' '.join([rule.predicate, *variables])})"):
                yield self._node(PREDICATE, rule.predicate, terms)

    def _set_function(self, request: Any, _: Any) -> None:
        fluent = _fluent(request.node)
        self._kb.function_values.set(str(fluent), value=request.node.value)

    def _update_function(self, request: Any, response: Any) -> None:
        fluent = _fluent(request.node)
        with self._kb.transaction():
            if self._kb.function_values.get(str(fluent)) is None:
                raise UnknownNameError(f"{fluent} has no value yet; add_problem_function sets one")
            self._set_function(request, response)

    def _remove_function(self, request: Any, _: Any) -> None:
        self._kb.function_values.unset(str(_fluent(request.node)))

    def _exists_function(self, request: Any, response: Any) -> None:
        response.exist = self._kb.function_values.get(str(_fluent(request.node))) is not None

    def _function(self, request: Any, response: Any) -> None:
        value = self._kb.function_values.get(request.expression)
        if value is None:
            raise UnknownNameError(f"{request.expression} has no value")
        name, *terms = request.expression.strip().strip("()").split()
        response.node = self._node(FUNCTION, name, terms, _number(request.expression, value))

    def _functions(self, _: Any, response: Any) -> None:
        values = self._kb.function_values.get_all()
        response.states = [
            self._node(
                FUNCTION,
                each.function.name,
                [one.name for one in each.objects],
                _number(each, each.value),
            )
            for each in values
        ]


def _stored(dto: PddlObjectDto | None, request: Any) -> PddlObjectDto:
    if dto is None:
        raise UnknownNameError(f"there is no instance {request.instance!r}")
    return dto


def _number(fluent: object, value: object) -> float:
    if isinstance(value, PddlObjectDto):
        raise InvalidKnowledgeError(f"{fluent} is an object, and PlanSys2's messages have numbers")
    return float(value)  # type: ignore[arg-type]


def _atom(node: Any) -> Atom:
    found = read_node(node) if node.node_type else read_node(_as(node, PREDICATE))
    if not isinstance(found, Atom):
        raise InvalidKnowledgeError(f"{found} is a function, expected a predicate")
    return found


def _fluent(node: Any) -> Fluent:
    found = read_node(node) if node.node_type else read_node(_as(node, FUNCTION))
    if not isinstance(found, Fluent):
        raise InvalidKnowledgeError(f"{found} is a predicate, expected a function")
    return found


def _as(node: Any, node_type: int) -> Any:
    """Say what a node is that leaves it out, as PlanSys2's details of predicates do."""
    node.node_type = node_type
    return node


class Planner:
    """Answers for `planner/...`, from the texts of the request alone."""

    def __init__(self, made: Any) -> None:
        self._made = made

    def services(self, kinds: Any) -> Iterator[Service]:
        """Yield the services; `kinds` is `plansys2_msgs.srv`."""
        yield Service("planner/validate_domain", kinds.ValidateDomain, _validate)
        yield Service("planner/get_plan", kinds.GetPlan, self._plan)

    def _plan(self, request: Any, response: Any) -> None:
        with kant_sql.connect("sqlite://") as kb:
            kb.load_domain(request.domain)
            kb.load_problem(request.problem)
            plan = kb.plan()
        items = [
            self._made.PlanItem(
                time=float(step.start or 0),
                action=f"({' '.join((step.action, *step.arguments))})",
                duration=float(step.duration or 0),
            )
            for step in plan.steps
        ]
        response.plan = self._made.Plan(items=items)


def _validate(request: Any, _: Any) -> None:
    read_domain(request.domain)
