"""Canonical text, the canonical form of a revision, and its hash; `docs/hash.md` specifies them.

The form is one JSON document in RFC 8785 (JSON Canonicalization Scheme): a program in any language
can recompute a hash from the tables.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import UTC, datetime
from functools import lru_cache
from hashlib import sha256
from itertools import islice
from json.encoder import encode_basestring
from typing import Any, NamedTuple, TypeVar

import rfc8785

from ..arguments import UNSTORABLE, shown
from ..dto.actions import action_text, duration_text
from ..dto.elements import function_text
from ..dto.formulas import Derived, Metric, Node, TimedLiteral, skeleton_text
from ..dto.lexical import declaration_text, either_text
from ..errors import InvalidArgumentError, InvalidMetadataError, KantSqlError
from ..pddl.writer import node_text
from .definitions import (
    ActionDefinition,
    Definition,
    Definitions,
    DocumentDefinition,
    FormulaDefinition,
    FunctionDefinition,
    ObjectDefinition,
    PredicateDefinition,
    RuleDefinition,
    TypeDefinition,
)
from .formulas import TreeReader, action_of
from .trees import ParameterDefinition

D = TypeVar("D", bound=Definition)

# The largest whole number that every JSON reader keeps exact (RFC 8785, appendix D).
_LARGEST_EXACT = 2**53 - 1


def canonical_text(definitions: Definitions, definition: Definition) -> str:
    """Write a definition, with the names of the elements it refers to."""
    return _TEXTS[type(definition)](definitions, definition)


def with_text(definitions: Definitions, definition: D) -> D:
    """Return a definition with its canonical text."""
    # The text is the last field of each; `_replace` takes three times as long.
    fields: Any = definition
    made: D = fields._make((*fields[:-1], canonical_text(definitions, definition)))
    return made


def type_text(definitions: Definitions, type_ids: Sequence[int]) -> str:
    """Write a type, or an `either`."""
    live = definitions.types.live
    if len(type_ids) == 1:
        return live(type_ids[0]).name
    return either_text(live(id_).name for id_ in type_ids)


def formula_text(node: Node) -> str:
    """Write a formula, a rule, the metric or a timed literal."""
    if isinstance(node, TimedLiteral):
        return str(node)
    if isinstance(node, Metric):
        return f"(:metric {node.optimization} {node_text(node.expression)})"
    if isinstance(node, Derived):
        head = skeleton_text(node.predicate, node.variables)
        return f"(:derived {head} {node_text(node.formula)})"
    return node_text(node)


def _type_texts(
    definitions: Definitions, parameters: Sequence[ParameterDefinition]
) -> tuple[list[str], list[str]]:
    """Write the types of parameters, and their names."""
    types = [type_text(definitions, parameter.type_ids) for parameter in parameters]
    return types, [parameter.name for parameter in parameters]


def _type(definitions: Definitions, type_: TypeDefinition) -> str:
    above = type_.parent_ids
    return f"{type_.name} - {type_text(definitions, above)}" if above else type_.name


def _object(definitions: Definitions, object_: ObjectDefinition) -> str:
    text = f"{object_.name} - {type_text(definitions, object_.type_ids)}"
    return f"(:constants {text})" if object_.is_constant else text


def _predicate(definitions: Definitions, predicate: PredicateDefinition) -> str:
    return declaration_text(predicate.name, *_type_texts(definitions, predicate.parameters))


def _function(definitions: Definitions, function: FunctionDefinition) -> str:
    types, names = _type_texts(definitions, function.parameters)
    values = [definitions.types.live(id_).name for id_ in function.type_ids]
    return function_text(function.name, types, values, names)


def _action(definitions: Definitions, action: ActionDefinition) -> str:
    read = action_of(definitions, action)
    return action_text(
        read.kind,
        read.name,
        [(each.name, each.type_text) for each in read.parameters],
        duration_text(read.duration),
        map(node_text, read.condition),
        map(node_text, read.effect),
    )


def _formula(definitions: Definitions, formula: FormulaDefinition) -> str:
    return formula_text(TreeReader(definitions, formula.tree).formula())


def _rule(definitions: Definitions, rule: RuleDefinition) -> str:
    formula = TreeReader(definitions, rule.constraint).formula()
    return f"(:rule {rule.name} :on-violation {rule.on_violation} {node_text(formula)})"


def _document(_: Definitions, document: DocumentDefinition) -> str:
    sections: dict[str, list[str]] = {}
    for item in document.items:
        sections.setdefault(item.section, []).append(item.name)
    parts = [f"(:{section} {' '.join(names)})" for section, names in sections.items()]
    of = [] if document.domain is None else [f"(:domain {document.domain})"]
    return f"(define {' '.join([f'({document.name} {document.title})', *of, *parts])})"


_TEXTS: dict[type[Any], Callable[[Definitions, Any], str]] = {
    TypeDefinition: _type,
    ObjectDefinition: _object,
    PredicateDefinition: _predicate,
    FunctionDefinition: _function,
    ActionDefinition: _action,
    FormulaDefinition: _formula,
    RuleDefinition: _rule,
    DocumentDefinition: _document,
}


# The form of new revisions; each revision stores and hashes its own.
FORM = 2
# Known forms: the first hashes texts, the second salted commitments to them.
FORMS = 1, FORM
# The texts of the metadata; the other fields are hashed as they are.
SAID = "actor", "reason", "source"
# Bytes of the seed of a revision, and of the salts derived from it.
SEED = 16
_BATCH = 1_000


class Metadata(NamedTuple):
    """Metadata of a revision.

    Attributes:
        source: a JSON document in canonical form.
        observed_at: the time of the observation, in UTC.
        plan_step: the running step: the id of its plan, and its position.
    """

    actor: str | None
    reason: str | None
    source: str | None
    observed_at: datetime | None = None
    plan_step: tuple[int, int] | None = None


def time_text(moment: datetime) -> str:
    """Write a time in the form that SQLite stores and the hash covers."""
    if moment.tzinfo is not UTC:
        moment = moment.astimezone(UTC)
    return moment.isoformat(timespec="microseconds")[:26] + "Z"


def text_time(text: str) -> datetime:
    """Read a time from the text that `time_text` writes."""
    moment = datetime.fromisoformat(text)
    # Converting a time that is already in UTC takes many times longer than reading it.
    return moment if moment.tzinfo is UTC else moment.astimezone(UTC)


def make_metadata(
    actor: str | None,
    reason: str | None,
    source: object | None,
    observed_at: datetime | None = None,
    plan_step: tuple[int, int] | None = None,
) -> Metadata:
    """Check metadata, and convert it to canonical form."""
    own = (in_utc("observed_at", observed_at, InvalidMetadataError), plan_step)
    for name, value in (("actor", actor), ("reason", reason)):
        if value is None:
            continue
        if not isinstance(value, str):
            raise InvalidMetadataError(f"{name} is a string or None, not {shown(value)}")
        if UNSTORABLE.search(value):
            raise InvalidMetadataError(
                f"{name} {shown(value)} has a NUL character or an unpaired surrogate"
            )
    if source is None:
        return Metadata(actor, reason, None, *own)
    try:
        text = rfc8785.dumps(source).decode()  # type: ignore[arg-type]
    except (rfc8785.CanonicalizationError, UnicodeError, RecursionError, TypeError) as error:
        raise InvalidMetadataError(f"source is not a JSON document: {error}") from error
    return Metadata(actor, reason, text, *own)


def read_source(text: str | None) -> Any:
    """Read the source of a revision from its canonical JSON."""
    return None if text is None else json.loads(text, parse_int=_number)


def _number(text: str) -> int | float:
    """Read a number without a point: RFC 8785 also writes large floats without one."""
    number = int(text)
    return number if abs(number) <= _LARGEST_EXACT else float(text)


def in_utc(
    name: str, moment: datetime | None, error: type[KantSqlError] = InvalidArgumentError
) -> datetime | None:
    """Check that a time has a zone, and return it in UTC."""
    if moment is None:
        return None
    if not isinstance(moment, datetime) or moment.utcoffset() is None:
        raise error(f"{name} is a time with its zone, not {shown(moment)}; give it one, as UTC")
    try:
        return moment.astimezone(UTC)
    except OverflowError as overflow:
        raise error(
            f"{name} {moment.isoformat()} lies outside the years 1 to 9999 in UTC"
        ) from overflow


def salt_of(seed: bytes, label: str, text: str) -> bytes:
    """Derive the salt of a part of a revision; the label of a change is its sign and its kind."""
    return sha256(seed + f"{label}\0{text}".encode()).digest()[:SEED]


def commit_to(salt: bytes, text: str) -> str:
    """Return the commitment to a text: without the salt, nobody can find the text from it."""
    return sha256(salt + text.encode()).hexdigest()


def revision_hash(
    previous: str | None,
    knowledge_base: str,
    number: int,
    committed_at: str,
    metadata: Metadata,
    changes: Iterable[tuple[str, str, str]],
    seed: bytes | None,
    form: int = FORM,
) -> str:
    """Hash a revision, chained to the previous one, in constant memory.

    Without a seed, the hash has form 1.
    """
    link = previous, knowledge_base, number, committed_at, metadata, form
    if seed is None:
        lines = (f'["{sign}","{kind}",{encode_basestring(text)}]' for sign, kind, text in changes)
        said = _json(metadata.actor), _json(metadata.reason), metadata.source or "null"
        return _hash(link, said, lines)
    actor, reason, source, _, _ = metadata
    sealed = (
        _seal(seed, b"actor", actor),
        _seal(seed, b"reason", reason),
        _seal(seed, b"source", source),
    )
    return _hash(link, sealed, _sealed(seed, changes))


def sealed_hash(
    previous: str | None,
    knowledge_base: str,
    number: int,
    committed_at: str,
    metadata: Metadata,
    said: Iterable[str | None],
    changes: Iterable[tuple[str, str, str]],
    form: int = FORM,
) -> str:
    """Hash a revision of form 2 from commitments to its actor, reason, source and changes."""
    actor, reason, source = map(_json, said)
    lines = (f'["{sign}","{kind}","{commitment}"]' for sign, kind, commitment in changes)
    link = previous, knowledge_base, number, committed_at, metadata, form
    return _hash(link, (actor, reason, source), lines)


def _seal(seed: bytes, label: bytes, text: str | None) -> str:
    """Write the commitment to a text of the metadata: `salt_of` and `commit_to` in one."""
    if text is None:
        return "null"
    raw = text.encode()
    salt = sha256(b"%b%b\0%b" % (seed, label, raw)).digest()[:SEED]
    return f'"{sha256(salt + raw).hexdigest()}"'


def _sealed(seed: bytes, changes: Iterable[tuple[str, str, str]]) -> Iterator[str]:
    """Write changes with a commitment to each text: `_seal` for many."""
    for sign, kind, text in changes:
        label, begin = _label(sign, kind)
        raw = text.encode()
        salt = sha256(seed + label + raw).digest()[:SEED]
        yield f'{begin}{sha256(salt + raw).hexdigest()}"]'


@lru_cache
def _label(sign: str, kind: str) -> tuple[bytes, str]:
    return f"{sign}{kind}\0".encode(), f'["{sign}","{kind}","'


# The hash before, the knowledge base, the number, the time, the metadata and the form.
_Link = tuple[str | None, str, int, str, Metadata, int]


def _hash(link: _Link, said: tuple[str, str, str], lines: Iterator[str]) -> str:
    """Hash the document of a revision, with its texts as its form requires."""
    previous, knowledge_base, number, committed_at, metadata, form = link
    actor, reason, source = said
    digest, text = sha256(), f'{{"actor":{actor},"changes":[{",".join(islice(lines, _BATCH))}'
    while batch := ",".join(islice(lines, _BATCH)):
        digest.update(text.encode())
        text = f",{batch}"
    observed, plan_step = metadata.observed_at, metadata.plan_step
    seen = "null" if observed is None else f'"{time_text(observed)}"'
    step = "null" if plan_step is None else "[{},{}]".format(*plan_step)
    digest.update(
        f'{text}],"committed_at":"{committed_at}","form":{form},'
        f'"knowledge_base":{encode_basestring(knowledge_base)},"number":{number},'
        f'"observed_at":{seen},"plan_step":{step},'
        f'"previous":{_json(previous)},"reason":{reason},"source":{source}}}'.encode()
    )
    return digest.hexdigest()


def _json(text: str | None) -> str:
    return "null" if text is None else encode_basestring(text)


def archive_text(id_: int, revision: int, target: str, versions: int, rest: str) -> str:
    """Write an archive record in canonical form."""
    to = json.dumps(target, ensure_ascii=False)
    return f'(archive {id_} :upto {revision} :to {to} :versions {versions} :rest "{rest}")'


def promotion_text(id_: int, revision: int, origin: str) -> str:
    """Write a promotion record in canonical form."""
    store = json.dumps(origin, ensure_ascii=False)
    return f"(promotion {id_} :upto {revision} :from {store})"


def erasure_text(
    id_: int,
    revision: int,
    kind: str,
    element_id: int | None,
    pseudonym: str,
    parts: int,
    digest: str,
) -> str:
    """Write an erasure record in canonical form."""
    what = f":{kind}" if element_id is None else f":{kind} {element_id}"
    said = f"{what} :as {json.dumps(pseudonym)} :parts {parts}"
    return f'(erasure {id_} :upto {revision} {said} :digest "{digest}")'
