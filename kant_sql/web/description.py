"""The page that describes the JSON interface, made from its OpenAPI document."""

from __future__ import annotations

from typing import Any, NamedTuple

from fastapi import FastAPI, Request
from fastapi.responses import HTMLResponse

from .rendering import render

_SCHEMA = "#/components/schemas/"


class ApiType(NamedTuple):
    """A type as words, and the schema that it leads to, if any."""

    text: str
    schema: str | None


class ApiField(NamedTuple):
    """A parameter of a question, or a field of a document."""

    name: str
    type: ApiType
    is_required: bool
    description: str
    default: str


class ApiQuestion(NamedTuple):
    """A path below `/api`."""

    path: str
    description: str
    parameters: list[ApiField]
    answer: ApiType


class ApiDocument(NamedTuple):
    """A document that an answer is, or contains."""

    name: str
    description: str
    fields: list[ApiField]


def describe(app: FastAPI) -> None:
    """Serve the page."""

    @app.get("/api", include_in_schema=False)
    async def description(request: Request) -> HTMLResponse:
        document = app.openapi()
        data = {"topics": _topics(document), "schemas": _schemas(document)}
        return render(request, "api.html", data, None)


def _topics(document: dict[str, Any]) -> dict[str, list[ApiQuestion]]:
    topics: dict[str, list[ApiQuestion]] = {}
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            good = next(code for code in operation["responses"] if code.startswith("2"))
            content = operation["responses"][good].get("content", {})
            schema = content.get("application/json", {}).get("schema", {})
            parameters = [
                _field(one["name"], one["schema"], one.get("required", False), one)
                for one in operation.get("parameters", ())
            ]
            named = path if method == "get" else f"{method.upper()} {path}"
            question = ApiQuestion(named, operation["description"], parameters, _type_name(schema))
            topics.setdefault(operation["tags"][0], []).append(question)
    return topics


def _schemas(document: dict[str, Any]) -> list[ApiDocument]:
    return [
        ApiDocument(
            name,
            schema.get("description", ""),
            [
                _field(field, of, field in schema.get("required", ()), of)
                for field, of in schema["properties"].items()
            ],
        )
        for name, schema in sorted(document["components"]["schemas"].items())
        if "properties" in schema and not name.endswith("Error")
    ]


def _field(name: str, schema: dict[str, Any], required: bool, said: dict[str, Any]) -> ApiField:
    default = schema.get("default")
    text = "" if default in (None, "") else str(default)
    return ApiField(name, _type_name(schema), required, said.get("description", ""), text)


def _type_name(schema: dict[str, Any]) -> ApiType:
    """Return a JSON schema as words."""
    if "$ref" in schema:
        name = schema["$ref"].removeprefix(_SCHEMA)
        return ApiType(name, name)
    if "anyOf" in schema:
        parts = [_type_name(part) for part in schema["anyOf"]]
        linked = next((part.schema for part in parts if part.schema), None)
        return ApiType(" or ".join(part.text for part in parts), linked)
    if "enum" in schema:
        return ApiType(" or ".join(f'"{value}"' for value in schema["enum"]), None)
    if schema.get("type") == "array":
        item = _type_name(schema.get("items", {}))
        return ApiType(f"array of {item.text}", item.schema)
    if "additionalProperties" in schema and isinstance(schema["additionalProperties"], dict):
        value = _type_name(schema["additionalProperties"])
        return ApiType(f"object of {value.text}", value.schema)
    return ApiType(str(schema.get("type", "any JSON value")), None)
