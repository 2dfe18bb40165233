"""The classes of results as OpenAPI describes their JSON, with what their docstrings say."""

from __future__ import annotations

import inspect
import re
from datetime import datetime
from decimal import Decimal
from functools import cache
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from pydantic import Field
from typing_extensions import TypedDict

from ..json_values import json_fields

_TEXTS = (datetime, Decimal)
_ATTRIBUTE = re.compile(r"^    (\w+): (.*(?:\n {8}.*)*)", re.MULTILINE)


def schema_of(annotation: Any) -> Any:
    """Return the type of the JSON of what is annotated so."""
    if annotation in _TEXTS:
        return str
    if isinstance(annotation, type) and not get_args(annotation):
        return _document(annotation)
    arguments = tuple(map(schema_of, get_args(annotation)))
    origin = get_origin(annotation)
    if origin is tuple or (isinstance(origin, type) and issubclass(origin, list)):
        return list[arguments[0]]  # type: ignore[valid-type]
    if isinstance(origin, type) and hasattr(origin, "keys"):
        return dict[arguments]  # type: ignore[misc,valid-type]
    return annotation if origin is None else _union(annotation, arguments)


def _union(annotation: Any, arguments: tuple[Any, ...]) -> Any:
    if isinstance(get_args(annotation)[0], str):
        return annotation
    made = arguments[0]
    for one in arguments[1:]:
        made |= one
    return made


@cache
def _document(kind: type) -> Any:
    """Make the type of the document of a class; another one is its own."""
    parts = json_fields(kind)
    if parts is None:
        return kind
    said = inspect.getdoc(kind) or ""
    description, _, attributes = said.partition("\n\nAttributes:\n")
    texts = {name: " ".join(text.split()) for name, text in _ATTRIBUTE.findall(attributes)}
    hints = get_type_hints(kind)
    made: dict[str, Any] = {}
    for key, name in parts:
        found = getattr(kind, name, None)
        if isinstance(found, property):
            hints[name] = get_type_hints(found.fget)["return"]
            texts[name] = inspect.getdoc(found) or ""
        schema = schema_of(hints[name])
        if key is None:
            made |= get_type_hints(schema, include_extras=True)
        else:
            made[key] = Annotated[schema, Field(description=texts.get(name) or None)]
    make: Any = TypedDict
    document = make(kind.__name__, made)
    document.__doc__, document.__module__ = description, kind.__module__
    return document
