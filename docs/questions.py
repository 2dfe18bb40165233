"""Shows the questions that `KnowledgeBase` binds as its methods, in the API reference."""

from __future__ import annotations

from typing import Any

from griffe import Extension, Function, Module, Parameter, Parameters

BINDERS = {"reads", "writes", "delegates"}


class Questions(Extension):
    """Makes a method of each `name = reads(lambda: package.module.name)`, with its docstring."""

    def on_package(self, *, pkg: Module, **_: Any) -> None:
        """Replace the attributes, when all modules are read."""
        if pkg.path != "kant_sql":
            return
        facade = pkg["knowledge_base.KnowledgeBase"]
        for name, member in list(facade.members.items()):
            call = str(member.value) if member.is_attribute and member.value is not None else ""
            binder, _, asked = call.removesuffix(")").partition("(")
            if binder in BINDERS:
                place = (
                    f"knowledge_base.{asked}" if binder == "delegates" else asked[len("lambda: ") :]
                )
                found = pkg[place]
                facade.set_member(name, _method(name, getattr(found, "final_target", found)))


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
