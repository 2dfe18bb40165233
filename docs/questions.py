"""Shows the questions that `KnowledgeBase` binds as its methods, in the API reference."""

from __future__ import annotations

from typing import Any

from griffe import Extension, Function, Module, Parameter, Parameters

import kant_sql

BINDERS = {"reads", "writes", "delegates"}
FRONTS = ("KnowledgeBase", "PddlParts", "Operations")


class Questions(Extension):
    """Makes a member of each `name = reads(lambda: package.module.name)`, with its docstring."""

    def on_package(self, *, pkg: Module, **_: Any) -> None:
        """Replace the attributes, when all modules are read."""
        if pkg.path != "kant_sql":
            return
        # They are computed, which this tool does not do.
        pkg.exports, pkg["pddl"].exports = kant_sql.__all__, kant_sql.pddl.__all__
        for path in (f"knowledge_base.{front}" for front in FRONTS):
            for name, member in list(pkg[path].members.items()):
                call = str(member.value) if member.is_attribute and member.value is not None else ""
                binder, _, asked = call.removesuffix(")").partition("(")
                if binder in BINDERS or binder == "creates":
                    place = asked.removeprefix("lambda: ")
                    found = pkg[place.replace("DaoFactory", "factory.DaoFactory")]
                    if binder in BINDERS:
                        pkg[path].set_member(name, _method(name, found))
                    else:
                        member.annotation, member.docstring = found.returns, found.docstring


def _method(name: str, question: Function) -> Function:
    method = Function(
        name,
        parameters=Parameters(Parameter("self"), *list(question.parameters)[1:]),
        returns=question.returns,
        docstring=question.docstring,
        lineno=question.lineno,
        endlineno=question.endlineno,
    )
    method.labels |= question.labels
    return method
