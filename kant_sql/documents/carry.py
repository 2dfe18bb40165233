"""Carries elements of one knowledge base into another: ids differ, so names identify them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import Any

from ..dao.action import read_parts
from ..dao.base import batches, identify
from ..dao.dependants import delete_mentioned
from ..dao.formula import read_formula, read_given
from ..dao.text import read_text
from ..dto.elements import atom_text
from ..dto.lexical import fold, is_same_number
from ..errors import ConflictError, InvalidKnowledgeError, TypeCycleError, few_of
from ..knowledge import definitions as d
from ..knowledge.atoms import AtomKey, FluentKey, FluentValue
from ..knowledge.canonical import canonical_text, with_text
from ..knowledge.formulas import TreeReader, action_of
from ..knowledge.rules import check_stratified
from ..knowledge.trees import Mentioned, ParameterDefinition, Tree
from ..pddl.given import read_rules
from ..sql.rows import FACT, GOAL, VALUE
from ..store.transaction import Transaction
from .load import misfits

# The kind and name of an element; for facts and formulas the text, for values the fluent.
Key = tuple[str, str]
# The new content of an element; None to remove it.
Wanted = Mapping[Key, str | None]
# Finds the id of a mentioned element: from its kind, and its id in the other knowledge base.
Find = Callable[[str, int], int]

SECTIONS = (*d.DOMAIN_SECTIONS, *d.PROBLEM_SECTIONS)
# The kinds of a state; a formula's kind is its section.
STATED = {*d.KINDS, *SECTIONS, FACT, GOAL, VALUE} - {"formula"}
_ONE_TYPE, _TYPES = ("parent_id", "type_id"), ("other_parent_ids", "other_type_ids", "type_ids")
_TREES = ("duration", "condition", "effect", "tree", "constraint")
_SHOWN = 10


def name_in(kind: str, text: str) -> str:
    """Return the name of an element in its text; there is one metric."""
    if kind == d.METRIC:
        return ""
    if kind == VALUE:
        return text[3:-1].rpartition(" ")[0]
    if kind in (FACT, GOAL, *SECTIONS):
        return text
    words = _words(text)
    return words[1] if kind == "document" or words[0].startswith(":") else words[0]


def is_same(key: Key, one: str | None, other: str | None) -> bool:
    """Return whether two texts of an element have the same meaning."""
    if one is None or other is None or fold(one) == fold(other):
        return (one is None) == (other is None)
    if key[0] != VALUE:
        return False
    return is_same_number(*(text[3:-1].rpartition(" ")[2] for text in (one, other)))


def _words(text: str) -> list[str]:
    return text.replace("(", " ").replace(")", " ").split()


def key_of(kind: str, definition: Any) -> Key:
    """Return the key of a definition."""
    kind = definition.section if kind == "formula" else kind
    return kind, fold(name_in(kind, definition.text))


def mentions_of(key: Key, text: str, definition: Any, known: d.Definitions) -> set[Key]:
    """Return the keys of the mentioned elements; facts and values have no definition."""
    if definition is None:
        head, *names = _words(fold(text))
        if key[0] == VALUE:
            # After the equals sign.
            return {("function", names[0]), *(("object", name) for name in names[1:])}
        return {("predicate", head), *(("object", name) for name in names)}
    found: set[Key] = set()

    def find(kind: str, id_: int) -> int:
        found.add((kind, fold(known.elements(kind).live(id_).name)))
        return id_

    _renamed(definition, find)
    return found


def _renamed(definition: Any, find: Find) -> Any:
    """Return a definition with the ids of its mentioned elements replaced."""
    changed: dict[str, Any] = {}
    for field, value in zip(definition._fields, definition, strict=True):
        if field in _ONE_TYPE and value is not None:
            changed[field] = find("type", value)
        elif field in _TYPES:
            changed[field] = tuple([find("type", id_) for id_ in value])
        elif field == "parameters":
            changed[field] = _parameters(value, find)
        elif field in _TREES:
            changed[field] = _tree(value, find)
    return definition._replace(**changed)


def _parameters(
    parameters: Iterable[ParameterDefinition], find: Find
) -> tuple[ParameterDefinition, ...]:
    return tuple(
        [
            ParameterDefinition(one.name, tuple([find("type", id_) for id_ in one.type_ids]))
            for one in parameters
        ]
    )


def _tree(tree: Tree, find: Find) -> Tree:
    def moved(kind: str, id_: int | None) -> int | None:
        return None if id_ is None else find(kind, id_)

    return tuple(
        [
            node._replace(
                predicate_id=moved("predicate", node.predicate_id),
                function_id=moved("function", node.function_id),
                terms=tuple(
                    [one._replace(object_id=moved("object", one.object_id)) for one in node.terms]
                ),
                variables=_parameters(node.variables, find),
            )
            for node in tree
        ]
    )


def carry(transaction: Transaction, others: d.Definitions, wanted: Wanted) -> None:
    """Write elements as they are in another knowledge base, or remove them.

    Args:
        transaction: the transaction that writes them.
        others: the definitions of the other knowledge base.
        wanted: the new content of each.

    Raises:
        ConflictError: an element mentions one that is missing here.
        InvalidKnowledgeError: types or rules of derived predicates would form a circle.
    """
    definitions = transaction.definitions
    formulas = {key_of("formula", one) for own in (definitions, others) for one in own.formulas}
    for kind in d.KINDS:
        _define(transaction, others, kind, wanted)
    for kind in ("document", "rule", "formula", "action"):
        for one in list(definitions.elements(kind)):
            key = key_of(kind, one)
            # There is one metric, whatever its content.
            is_other = key[0] == d.METRIC and fold(wanted.get(key) or "") != fold(one.text)
            if key in wanted and (wanted[key] is None or is_other):
                transaction.undefine(kind, one.id)
    for kind in (FACT, GOAL):
        _hold(transaction, kind, [key for key in wanted if key[0] == kind], wanted, formulas)
    _set_values(transaction, wanted)
    gone = [
        {one.id for one in definitions.elements(kind) if wanted.get(key_of(kind, one), "") is None}
        for kind in d.DECLARED
    ]
    if any(gone):
        delete_mentioned(transaction, Mentioned(*gone))
    if any(kind == d.DERIVED_PREDICATE for kind, _ in wanted):
        check_stratified(definitions)


def _define(transaction: Transaction, others: d.Definitions, kind: str, wanted: Wanted) -> None:
    """Define the wanted elements of a kind; kinds mention only earlier kinds, types each other."""
    definitions = transaction.definitions
    brought = [one for one in others.elements(kind) if wanted.get(key_of(kind, one)) is not None]
    if not brought:
        return

    def find(kind: str, id_: int) -> int:
        name = others.elements(kind).live(id_).name
        found = definitions.elements(kind).named(name)
        if found is None:
            raise _missing(kind, name)
        return int(found.id)

    transaction.look_up(kind, [one.name for one in brought])
    if kind == "type":
        for one in brought:
            if definitions.types.named(one.name) is None:
                bare = d.TypeDefinition(*identify(transaction, kind, one.name), None, (), one.name)
                transaction.define(kind, bare)
    for one in brought:
        made, name = _renamed(one, find), one.name
        if kind == "formula":
            name = d.formula_name(one.section, canonical_text(definitions, made))
        id_, name = identify(transaction, kind, name)
        transaction.define(kind, with_text(definitions, made._replace(id=id_, name=name)))
    if kind == "type":
        _refuse_circles(definitions, [one.name for one in brought])


def _refuse_circles(definitions: d.Definitions, names: Iterable[str]) -> None:
    for own in filter(None, map(definitions.types.named, names)):
        if any(each.id == own.id for id_ in own.parent_ids for each in definitions.ancestry(id_)):
            raise TypeCycleError(
                f"type {own.name!r} would be its own ancestor: one side puts it below another "
                "type, and the other side that one below it; change one of the two"
            )


def _missing(kind: str, name: str) -> ConflictError:
    return ConflictError(
        f"the branch mentions {kind} {name!r}, which is missing here; save it here, or delete the "
        "elements of the branch that mention it"
    )


def _key(transaction: Transaction, kind: str, words: list[str]) -> tuple[int, str, str]:
    """Find the id and the arguments of an atom or a fluent, and write its text."""
    definitions, (head, *names) = transaction.definitions, words
    owner = definitions.elements(kind).named(head)
    if owner is None:
        raise _missing(kind, head)
    objects = []
    for name in names:
        found = definitions.objects.named(name)
        if found is None:
            raise _missing("object", name)
        objects.append(found)
    text = atom_text(owner.name, [one.name for one in objects])
    return owner.id, " ".join(str(one.id) for one in objects), text


def _hold(
    transaction: Transaction, kind: str, keys: list[Key], wanted: Wanted, formulas: set[Key]
) -> None:
    """Assert and retract facts, or goals that are atoms."""
    propositions = transaction.propositions if keys else None
    for batch in batches(key for key in keys if key not in formulas):
        assert propositions is not None
        texts: dict[bool, dict[AtomKey, str]] = {True: {}, False: {}}
        for key in batch:
            id_, arguments, text = _key(transaction, "predicate", _words(key[1]))
            texts[wanted[key] is not None][AtomKey(kind == GOAL, id_, arguments)] = text
        ending = propositions.find(texts[False])
        propositions.load(ending.values())
        for atom in ending.values():
            propositions.set(atom, False)
        propositions.hold_all(texts[True])
        transaction.spill()


def _set_values(transaction: Transaction, wanted: Wanted) -> None:
    for batch in batches(key for key in wanted if key[0] == VALUE):
        values, ending = [], []
        for key in batch:
            id_, arguments, text = _key(transaction, "function", _words(key[1]))
            said, fluent = wanted[key], FluentKey(id_, arguments)
            if said is None:
                ending.append(fluent)
                continue
            value = said[3:-1].rpartition(" ")[2]
            function = transaction.definitions.functions.live(id_)
            object_ = transaction.definitions.objects.named(value) if function.type_ids else None
            if function.type_ids and object_ is None:
                raise _missing("object", value)
            held = FluentValue(value) if object_ is None else FluentValue(object_.name, object_.id)
            values.append((fluent, text, held))
        found = transaction.values.find(ending)
        transaction.values.load(found.values())
        for each in found.values():
            transaction.values.set(each, None)
        transaction.values.set_many(values)


def refuse_misfits(transaction: Transaction) -> None:
    """Refuse definitions that elements do not fit: each side fitted only its own definitions."""
    wrong = [*_misfits(transaction)]
    if wrong:
        raise ConflictError(
            "definitions of one side do not fit elements of the other: "
            f"{few_of(wrong, _SHOWN)}; nothing was written: change one of the two"
        )


def _misfits(transaction: Transaction) -> Iterator[str]:
    definitions = transaction.definitions
    atoms, values = misfits(transaction)
    yield from (f"{GOAL if one.key.is_goal else FACT} {one.text}" for one in atoms)
    yield from (f"value {one.text}" for one in values)
    checks: list[tuple[str, Callable[[], object]]] = []
    for formula in definitions.formulas:
        node = read_formula(definitions, formula)
        check = partial(read_given, transaction, formula.section, node)
        checks.append((f"{formula.section} {formula.text}", check))
    for action in definitions.actions:
        read = action_of(definitions, action)
        parts = read.duration, read.condition, read.effect
        own = action.kind, action.name, read.parameters, parts
        checks.append((f"action {action.name}", partial(read_parts, transaction, *own)))
    for rule in definitions.rules:
        text = str(TreeReader(definitions, rule.constraint).formula())
        again = partial(read_text, transaction, read_rules, text)
        checks.append((f"rule {rule.name}", again))
    for said, call in checks:
        try:
            call()
        except InvalidKnowledgeError:
            yield said
