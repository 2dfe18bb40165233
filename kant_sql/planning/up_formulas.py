"""Types, formulas and preferences converted to unified-planning."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from fractions import Fraction
from functools import reduce
from itertools import chain, compress, product
from typing import TYPE_CHECKING

from ..dto import formulas as f
from ..dto.lexical import ROOT_TYPE, fold
from ..errors import UnsupportedConstructError
from ..pddl.document import Domain, Problem, typed_names
from . import names as n
from .metrics import ONE, NotLinearError, hard, linear

if TYPE_CHECKING:
    from unified_planning.environment import Environment
    from unified_planning.model import Fluent as UpFluent
    from unified_planning.model import FNode, Type
    from unified_planning.model import Object as UpObject
    from unified_planning.model import Problem as UpProblem
    from unified_planning.model import Variable as UpVariable


class UpTypes:
    """The hierarchy of types.

    `object` is a type of unified-planning only if the documents need it; otherwise types without a
    supertype are roots, as in unified-planning's own reader.
    """

    def __init__(
        self, domain: Domain, problem: Problem, names: n.UpNames, environment: Environment
    ) -> None:
        self._names, self._manager = names, environment.type_manager
        self._spelling = {ROOT_TYPE: ROOT_TYPE}
        self._above: dict[str, tuple[str, ...]] = {ROOT_TYPE: ()}
        self._declared = [key for part in domain.types if (key := fold(part.name)) != ROOT_TYPE]
        for part in domain.types:
            self._spelling[fold(part.name)] = part.name
            self._above[fold(part.name)] = tuple(map(fold, part.types))
        self._above[ROOT_TYPE] = ()
        values = (f.TypedName(one.name, one.types) for one in domain.functions if one.types)
        used = [*typed_names(domain, problem), *values]
        for name in chain.from_iterable(part.types for part in (*domain.types, *used)):
            self._spelling.setdefault(fold(name), name)
            self._above.setdefault(fold(name), (ROOT_TYPE,))
        self._father = {key: self._only_father(key) for key in self._above}
        self._rooted = any(self._widest(part.types) == ROOT_TYPE for part in used)
        self._types: dict[str, Type] = {}

    def all(self) -> list[Type]:
        """Return the types that the domain declares."""
        return [self._type(key) for key in self._declared]

    def widest(self, types: Iterable[str]) -> Type:
        """Return the narrowest common supertype."""
        return self._type(self._widest(types))

    def branches(self, types: Iterable[str]) -> list[Type]:
        """Return the types of an `either` without subtypes of others."""
        keys = list(dict.fromkeys(map(fold, types)))
        kept = [key for key in keys if not set(self._ancestors(key)[1:]) & set(keys)]
        return [self._type(key) for key in kept]

    def narrowest(self, types: Iterable[str]) -> list[Type]:
        """Return the most specific types of an object, which has all of them."""
        keys = list(dict.fromkeys(map(fold, types)))
        above = {name for key in keys for name in self._ancestors(key)[1:]}
        return [self._type(key) for key in keys if key not in above]

    def _type(self, key: str) -> Type:
        if key not in self._types:
            father = self._father[key]
            above = None
            if father is not None and (father != ROOT_TYPE or self._rooted):
                above = self._type(father)
            name = self._names.of(n.TYPE, self._spelling[key])
            self._types[key] = self._manager.UserType(name, above)
        return self._types[key]

    def _widest(self, types: Iterable[str]) -> str:
        chains = [self._ancestors(fold(name)) for name in types]
        return next(key for key in chains[0] if all(key in chain for chain in chains))

    def _ancestors(self, key: str) -> list[str]:
        found = [key]
        for above in found:
            found.extend(name for name in self._above[above] if name not in found)
        if ROOT_TYPE in found:
            found.remove(ROOT_TYPE)
        return [*found, ROOT_TYPE]

    def _only_father(self, key: str) -> str | None:
        above = [name for name in dict.fromkeys(self._above[key]) if name != key]
        near = [
            name for name in above if not any(name in self._ancestors(other)[1:] for other in above)
        ]
        if len(near) > 1:
            supertypes = " and ".join(self._spelling[name] for name in near)
            raise UnsupportedConstructError(
                f"unified-planning cannot express type {self._spelling[key]}: it has the "
                f"supertypes {supertypes}, where one is possible; give it one supertype"
            )
        return near[0] if near else None


@dataclass(frozen=True, slots=True)
class Bindings:
    """The variables that a formula may mention."""

    # The value of each variable, by folded name.
    bound: dict[str, FNode] = field(default_factory=dict)
    # The folded names of unified-planning's parameters and variables in scope.
    names: frozenset[str] = frozenset()

    def fresh(self, name: str) -> str:
        """Return a name that hides no variable in scope."""
        return n.unused_name(name, self.names)

    def bind(self, name: str, node: FNode) -> Bindings:
        """Bind a variable to a value."""
        taken = self.names
        if node.is_parameter_exp():
            taken |= {fold(node.parameter().name)}
        elif node.is_variable_exp():
            taken |= {fold(node.variable().name)}
        return Bindings({**self.bound, fold(name): node}, taken)


@dataclass
class ConversionContext:
    """A conversion in progress."""

    environment: Environment
    problem: UpProblem  # the resulting problem
    names: n.UpNames
    types: UpTypes
    # Predicates and functions, by category and folded name.
    fluents: dict[tuple[str, str], UpFluent] = field(default_factory=dict)
    objects: dict[str, UpObject] = field(default_factory=dict)  # the objects, by folded name
    # The rules of derived predicates, by folded name.
    rules: dict[str, list[f.Derived]] = field(default_factory=dict)
    static: frozenset[str] = frozenset()  # the folded names of the functions that never change
    integers: bool = False  # whether numeric fluents are integers
    costed: bool = False  # whether `total-cost` is the cost of the actions, not a fluent
    where: str = ""  # the construct in conversion, for messages

    @contextmanager
    def at(self, where: str) -> Iterator[None]:
        """Set the construct in conversion, and translate unified-planning's errors."""
        from unified_planning.exceptions import UPException

        outer, self.where = self.where, where
        try:
            yield
        except UPException as error:
            reason = " ".join(" ".join(map(str, error.args)).split())
            raise UnsupportedConstructError(
                f"unified-planning refuses {where}: {reason or type(error).__name__}"
            ) from error
        finally:
            self.where = outer

    def unsupported(self, construct: object, reason: str) -> UnsupportedConstructError:
        """Make the error for a construct without a counterpart."""
        return n.unsupported("unified-planning", construct, self.where, reason)


class UpConverter:
    """A part of a conversion."""

    def __init__(self, context: ConversionContext) -> None:
        self._context = context
        self._manager = context.environment.expression_manager
        self._unsupported = context.unsupported


class UpFormulas(UpConverter):
    """Converts formulas; a derived predicate is replaced by the bodies of its rules."""

    def __init__(self, context: ConversionContext) -> None:
        super().__init__(context)
        self._expanding: list[str] = []
        self._expanded: dict[tuple[str, tuple[FNode, ...]], FNode] = {}

    def formula(self, node: f.Formula, scope: Bindings) -> FNode:
        """Convert a condition."""
        match node:
            case f.Atom(predicate) if fold(predicate) in self._context.rules:
                return self._derived(node, scope)
            case f.Atom(predicate, terms):
                return self._applied(n.PREDICATE, predicate, node, terms, scope)
            case f.Not(inner):
                return self._manager.Not(self.formula(inner, scope))
            case f.And(parts):
                return self._manager.And([self.formula(part, scope) for part in parts])
            case f.Or(parts):
                return self._manager.Or([self.formula(part, scope) for part in parts])
            case f.Imply(condition, inner):
                return self._manager.Implies(
                    self.formula(condition, scope), self.formula(inner, scope)
                )
            case f.Forall(variables, inner) | f.Exists(variables, inner):
                return self._quantified(isinstance(node, f.Forall), variables, inner, scope)
            case f.Equal(left, right):
                return self._equal(node, self.term(left, scope), self.term(right, scope))
            case f.Comparison(operator, left, right):
                compare = getattr(self._manager, n.UP_COMPARISONS[operator])
                return compare(self.expression(left, scope), self.expression(right, scope))
        raise self._unsupported(node, "it is not a condition on a state")

    def term(self, node: f.Term, scope: Bindings) -> FNode:
        """Convert a term."""
        match node:
            case f.Variable(name):
                if fold(name) in scope.bound:
                    return scope.bound[fold(name)]
                raise self._unsupported(node, "it is unbound here, or has no fixed value")
            case f.Constant(name):
                if fold(name) in self._context.objects:
                    return self._manager.ObjectExp(self._context.objects[fold(name)])
                raise self._unsupported(node, "it is not an object of the problem")
        return self.fluent(node, scope)

    def fluent(self, node: f.Fluent, scope: Bindings) -> FNode:
        """Convert a function applied to terms."""
        return self._applied(n.FUNCTION, node.function, node, node.terms, scope)

    def expression(self, node: f.Expression, scope: Bindings) -> FNode:
        """Convert a numeric expression."""
        match node:
            case f.Number(value):
                fraction = Fraction(value)
                if fraction.denominator == 1:
                    return self._manager.Int(fraction.numerator)
                return self._manager.Real(fraction)
            case f.Arithmetic():
                return self._arithmetic(node, scope)
            case f.Fluent() | f.Variable():
                value = self.term(node, scope)
                if value.type.is_real_type() or value.type.is_int_type():
                    return value
        raise self._unsupported(node, "it is not a number that a state holds")

    def variables(
        self, names: Sequence[f.TypedName], scope: Bindings
    ) -> Iterator[tuple[tuple[UpVariable, ...], Bindings]]:
        """Bind the variables of a quantifier, once for each choice of types."""
        from unified_planning.model import Variable as UpVariable

        for types in product(*(self._context.types.branches(name.types) for name in names)):
            bound, within = [], scope
            for name, chosen in zip(names, types, strict=True):
                variable = UpVariable(within.fresh(name.name), chosen, self._context.environment)
                within = within.bind(name.name, self._manager.VariableExp(variable))
                bound.append(variable)
            yield tuple(bound), within

    def _quantified(
        self, universal: bool, names: Sequence[f.TypedName], inner: f.Formula, scope: Bindings
    ) -> FNode:
        parts = [
            self.quantified(self.formula(inner, within), variables, universal)
            for variables, within in self.variables(names, scope)
        ]
        return self._manager.And(parts) if universal else self._manager.Or(parts)

    def quantified(
        self, node: FNode, variables: Sequence[UpVariable], universal: bool = True
    ) -> FNode:
        """Quantify a formula over variables, if there are any."""
        quantifier = self._manager.Forall if universal else self._manager.Exists
        objects = self._context.problem.objects
        if any(next(iter(objects(each.type)), None) is None for each in variables):
            # Without an object, unified-planning would still simplify it to its body.
            return self._manager.Bool(universal)
        return quantifier(node, *variables) if variables else node

    def _equal(self, node: f.Equal, left: FNode, right: FNode) -> FNode:
        if not (left.type.is_user_type() and right.type.is_user_type()):
            raise self._unsupported(node, "its terms are not objects")
        roots = [list(node.type.ancestors)[-1] for node in (left, right)]
        if roots[0] != roots[1]:
            return self._manager.FALSE()
        return self._manager.Equals(left, right)

    def _arithmetic(self, node: f.Arithmetic, scope: Bindings) -> FNode:
        operands = [self.expression(operand, scope) for operand in node.operands]
        if node.operator == "-" and len(operands) == 1:
            return self._manager.Times(-1, operands[0])
        if node.operator == "/" and any(
            divisor.is_constant() and divisor.constant_value() == 0 for divisor in operands[1:]
        ):
            raise self._unsupported(node, "it divides by zero")
        join = getattr(self._manager, n.UP_ARITHMETIC[node.operator])
        return join(operands) if node.operator in {"+", "*"} else reduce(join, operands)

    def _applied(
        self, category: str, name: str, node: object, terms: Sequence[f.Term], scope: Bindings
    ) -> FNode:
        fluent = self._context.fluents.get((category, fold(name)))
        if fluent is None:
            raise self._unsupported(node, f"{category} {name} is not a fluent there")
        arguments = [self.term(term, scope) for term in terms]
        if len(arguments) != fluent.arity:
            raise self._unsupported(node, f"{name} has {fluent.arity} parameters")
        for parameter, argument in zip(fluent.signature, arguments, strict=True):
            if not parameter.type.is_compatible(argument.type):
                reason = f"{argument} is of type {argument.type}, not of {parameter.type}"
                raise self._unsupported(node, reason)
        return self._manager.FluentExp(fluent, arguments)

    def _derived(self, node: f.Atom, scope: Bindings) -> FNode:
        key = fold(node.predicate)
        if key in self._expanding:
            reason = "a derived predicate that depends on itself has no counterpart"
            raise self._unsupported(node, reason)
        arguments = tuple(self.term(term, scope) for term in node.terms)
        if (key, arguments) not in self._expanded:
            self._expanding.append(key)
            bodies = [
                self._body(rule.variables, rule.formula, arguments, scope)
                for rule in self._context.rules[key]
            ]
            self._expanding.pop()
            self._expanded[key, arguments] = self._manager.Or(bodies)
        return self._expanded[key, arguments]

    def _body(
        self,
        head: Sequence[f.TypedName],
        body: f.Formula,
        arguments: Sequence[FNode],
        scope: Bindings,
    ) -> FNode:
        within = Bindings({}, scope.names)
        for name, argument in zip(head, arguments, strict=True):
            branches = self._context.types.branches(name.types)
            if not any(branch.is_compatible(argument.type) for branch in branches):
                reason = f"its rule holds for {name.type_text} only, a narrower type"
                raise self._unsupported(argument, reason)
            within = within.bind(name.name, argument)
        return self.formula(body, within)


class UpPreferences(UpConverter):
    """The preferences of a problem and their weights in the metric."""

    def __init__(
        self, metric: f.Metric | None, context: ConversionContext, formulas: UpFormulas
    ) -> None:
        super().__init__(context)
        self._formulas = formulas
        # The gain of each preference that the metric counts, by its folded name.
        self.weights: dict[str, Fraction] = {}
        self.gains: dict[FNode, Fraction] = {}  # the gain of each preferred goal
        if metric is not None and f.mentions(f.IsViolated, metric.expression):
            with context.at("the metric"):
                sign = 1 if metric.optimization == "minimize" else -1
                self.weights = {
                    name: sign * weight for name, weight in self._violations(metric) if weight
                }

    def _violations(self, metric: f.Metric) -> Iterator[tuple[str, Fraction]]:
        reason = "a sum of violations and other quantities has no counterpart"
        try:
            weights = linear(metric.expression)
        except NotLinearError as error:
            raise self._unsupported(error.args[0], reason) from None
        for node, weight in weights.items():
            if isinstance(node, f.IsViolated):
                yield node.preference, weight
            elif node != ONE:
                raise self._unsupported(node, reason)

    def without(self, nodes: Sequence[f.Formula]) -> Iterator[f.Formula]:
        """Drop the preferences that the metric does not count."""
        for node in f.walk(*nodes):
            if isinstance(node, f.Preference) and self._weight(node.name):
                reason = "only a preference in the goal can be counted by a metric there"
                raise self._unsupported(node, reason)
        return hard(nodes)

    def goals(self, nodes: Iterable[f.Formula], scope: Bindings) -> Iterator[FNode]:
        """Convert goals, and add up the gains of preferences."""
        for node in nodes:
            match node:
                case f.Preference(name, inner):
                    if weight := self._weight(name):
                        goal = self._formulas.formula(inner, scope)
                        self.gains[goal] = self.gains.get(goal, Fraction(0)) + weight
                case f.And(parts):
                    yield from self.goals(parts, scope)
                case f.Forall(variables, inner) if f.mentions(f.Preference, inner):
                    for within in self._instances(variables, scope):
                        yield from self.goals([inner], within)
                case _:
                    yield self._formulas.formula(node, scope)

    def _instances(self, variables: Sequence[f.TypedName], scope: Bindings) -> Iterator[Bindings]:
        objects, choices = self._context.objects.values(), []
        for variable in variables:
            types = self._context.types.branches(variable.types)
            fits = (any(type_.is_compatible(item.type) for type_ in types) for item in objects)
            choices.append(list(compress(objects, fits)))
        for chosen in product(*choices):
            within = scope
            for variable, item in zip(variables, chosen, strict=True):
                within = within.bind(variable.name, self._manager.ObjectExp(item))
            yield within

    def _weight(self, name: str | None) -> Fraction:
        return self.weights.get(fold(name), Fraction(0)) if name else Fraction(0)
