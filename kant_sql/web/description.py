"""OpenAPI's description of the results, and the page made from it."""

from __future__ import annotations

import inspect
import re
from datetime import datetime
from decimal import Decimal
from functools import cache, reduce
from operator import or_
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

from fastapi import FastAPI, Request
from fastapi.responses import HTMLResponse
from pydantic import Field
from typing_extensions import TypedDict

from ..json_values import json_fields
from .rendering import render

_TEXTS = (datetime, Decimal)
_ITEM = re.compile(r"^    (\w+): (.*(?:\n {8}.*)*)", re.MULTILINE)


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
    # One of some words stays as it is.
    is_plain = origin is None or isinstance(get_args(annotation)[0], str)
    return annotation if is_plain else reduce(or_, arguments)


def texts_of(documented: object, section: str) -> tuple[str, dict[str, str]]:
    """Return the text of a docstring, and the texts of the names in a section."""
    said = inspect.getdoc(documented) or ""
    description, _, items = said.partition(f"\n\n{section}:\n")
    return description, {name: " ".join(text.split()) for name, text in _ITEM.findall(items)}


@cache
def _document(kind: type) -> Any:
    """Make the type of a class's document; other types stay."""
    parts = json_fields(kind)
    if parts is None:
        return kind
    description, texts = texts_of(kind, "Attributes")
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


_SCHEMA = "#/components/schemas/"


class ApiType(NamedTuple):
    """A type as words, and the schema that it leads to, if any."""

    text: str
    schema: str | None


def describe(app: FastAPI) -> None:
    """Serve the page."""

    @app.get("/api", include_in_schema=False)
    async def description(request: Request) -> HTMLResponse:
        document = app.openapi()
        data = {"topics": _topics(document), "documents": _documents(document), "type": type_of}
        return render(request, "api.html", data, None)


def _topics(document: dict[str, Any]) -> dict[str, list[dict[str, Any]]]:
    """Return the operations by topic, each with its path and the schema of its answer."""
    topics: dict[str, list[dict[str, Any]]] = {}
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            good = next(code for code in operation["responses"] if code.startswith("2"))
            content = operation["responses"][good].get("content", {})
            answer = content.get("application/json", {}).get("schema", {})
            named = path if method == "get" else f"{method.upper()} {path}"
            topics.setdefault(operation["tags"][0], []).append(
                {**operation, "path": named, "answer": answer}
            )
    return topics


def _documents(document: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the schemas of answers and their parts, by name."""
    return {
        name: schema
        for name, schema in sorted(document["components"]["schemas"].items())
        if "properties" in schema and not name.endswith("Error")
    }


def type_of(schema: dict[str, Any]) -> ApiType:
    """Return a JSON schema as words."""
    if "$ref" in schema:
        name = schema["$ref"].removeprefix(_SCHEMA)
        return ApiType(name, name)
    if "anyOf" in schema:
        parts = [type_of(part) for part in schema["anyOf"]]
        linked = next((part.schema for part in parts if part.schema), None)
        return ApiType(" or ".join(part.text for part in parts), linked)
    if "enum" in schema:
        return ApiType(" or ".join(f'"{value}"' for value in schema["enum"]), None)
    if schema.get("type") == "array":
        item = type_of(schema.get("items", {}))
        return ApiType(f"array of {item.text}", item.schema)
    if "additionalProperties" in schema and isinstance(schema["additionalProperties"], dict):
        value = type_of(schema["additionalProperties"])
        return ApiType(f"object of {value.text}", value.schema)
    return ApiType(str(schema.get("type", "any JSON value")), None)
