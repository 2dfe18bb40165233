"""Terms and atoms: predicates and functions applied to variables, objects and object fluents."""

from __future__ import annotations

from typing import NoReturn

from ..dto.formula import Atom, Constant, Fluent, Term, TypedName
from ..dto.name import fold, is_name
from ..dto.node import shown
from .cursor import Reading, Steps, finished, hint
from .hierarchy import Fit, Types
from .section import Section
from .signatures import Named, Signature
from .symbols import Bound, Entity, Symbols
from .typed_lists import VARIABLES, Group, ListReader

DURATION = "?duration"


class TermReader(ListReader):
    """A reader of terms and atoms.

    Attributes:
        duration_allowed: whether `?duration` is the duration of the action.
        symbols: the names that may be used.
        scope: the variables that may be used, folded and as they were bound, each with its `?`.
    """

    duration_allowed = False

    def __init__(self, reading: Reading, section: Section, symbols: Symbols, nesting: str) -> None:
        super().__init__(reading, section, nesting)
        self.symbols = symbols

    def open(self, section: Section, nesting: str) -> None:
        """Go to the beginning of a section, where no variables are bound.

        Args:
            section: the section.
            nesting: what it is, for messages.
        """
        super().open(section, nesting)
        self.scope: dict[str, Entity] = {}
        # What each change of the scope took the place of: copies would be quadratic in the depth.
        self._outside: list[tuple[str, Entity | None]] = []

    def mark(self) -> int:
        """Mark a place, behind which variables are bound.

        Returns:
            The mark, for `release`.
        """
        return len(self._outside)

    def release(self, mark: int) -> None:
        """Let only those variables be used that could be at a mark.

        Args:
            mark: the mark.
        """
        while len(self._outside) > mark:
            spelling, entity = self._outside.pop()
            if entity is None:
                del self.scope[spelling]
            else:
                self.scope[spelling] = entity

    def variables(self) -> tuple[TypedName, ...]:
        """Read a parenthesised list of typed variables, and let them be used from here on.

        Returns:
            The variables, in order.
        """
        self.expect("(", "'(' before the variables")
        return self.bind(self.typed_list(VARIABLES))

    def bind(self, groups: list[Group]) -> tuple[TypedName, ...]:
        """Let variables be used from here on, beside those that may be.

        Args:
            groups: the variables, as written.

        Returns:
            The variables, in order.
        """
        symbols = self.symbols
        scope = self.scope
        found: dict[str, Bound] = {}
        for group in groups:
            types = self.resolve(symbols, group.types, group.types_at)
            for word in group.words:
                bound = symbols.bound(word, types)
                if self.duration_allowed and bound.key == DURATION:
                    place = group.at + group.words.index(word)
                    self.fail("a variable that is not the duration of the action", at=place)
                key = bound.key
                if key in found:
                    at = group.at + group.words.index(word)
                    self.fail("each variable once", f"the variable '{word}' again", at)
                found[key] = bound
                outside = scope.get(key)
                if outside is not None and str(outside[0]) != key:
                    # It is bound in another spelling, too, which means the new one from here on.
                    self._outside.append((str(outside[0]), outside))
                    scope[str(outside[0])] = bound.entity
                self._outside.append((key, outside))
                scope[key] = bound.entity
                if word != key:
                    self._outside.append((word, scope.get(word)))
                    scope[word] = bound.entity
        return tuple([bound.declared for bound in found.values()])

    def variable(self, token: str) -> Entity | None:
        """Look up a variable.

        Args:
            token: its name in any spelling, with its question mark.

        Returns:
            It and its types; None when it is not bound.
        """
        return self.scope.get(token) or self.scope.get(fold(token))

    def atom(self, signature: Signature) -> Atom:
        """Read an atom.

        Args:
            signature: its predicate, whose name is the token behind the parenthesis.

        Returns:
            The atom.
        """
        if not signature.accepted and self.tokens[self.at + 2] == ")":
            self.at += 3
            return signature.bare
        return Atom(signature.name, self.arguments(signature))

    def arguments(self, signature: Signature) -> tuple[Term, ...]:
        """Read the arguments of a predicate or function, and the parenthesis behind them.

        Args:
            signature: the predicate or function, whose parenthesis is the next token.

        Returns:
            The arguments.
        """
        if signature.parameters is None:
            return self._any_arguments()
        tokens, scope, objects = self.tokens, self.scope, self.symbols.objects
        start = self.at
        at = start + 2
        terms: list[Term] = []
        for wanted, accepted in signature.accepted:
            word = tokens[at]
            entity = scope.get(word) or objects.get(word)
            if entity is None or (entity[1] is not wanted and entity[1] not in accepted):
                self.at = at
                terms.append(self._argument(signature, len(terms), start))
                at = self.at
            else:
                terms.append(entity[0])
                at += 1
        self.at = at + 1
        if tokens[at] != ")":
            self._wrong_number(signature, start, at)
        return tuple(terms)

    def _any_arguments(self) -> tuple[Term, ...]:
        self.at += 2
        terms = []
        while self.tokens[self.at] != ")":
            terms.append(self.term()[0])
        self.at += 1
        return tuple(terms)

    def _wrong_number(self, signature: Signature, start: int, at: int) -> None:
        wanted = len(signature.accepted)
        arguments = f"{wanted} argument{'' if wanted == 1 else 's'} of {signature.name}"
        if self.tokens[at] == ")":
            given = sum(1 for token in self.tokens[start + 2 : at] if token not in ("(", ")"))
            self.fail(arguments, f"{given}", at)
        self.fail(f"')' after the {arguments}", at=at)

    def _argument(self, signature: Signature, place: int, start: int) -> Term:
        """Read one argument with all checks."""
        at = self.at
        if self.tokens[at] == ")":
            self._wrong_number(signature, start, at)
        entity = self.term()
        self._check_fit(signature, place, entity, at)
        return entity[0]

    def _check_fit(self, signature: Signature, place: int, entity: Entity, at: int) -> None:
        """Check that a term, whose first token is given, fits the parameter in a place."""
        wanted, accepted = signature.accepted[place]
        if self.symbols.fit(entity[1], wanted) is Fit.YES:
            accepted.add(entity[1])
        else:
            self.misfit(entity, wanted, f"as argument {place + 1} of {signature.name}", at)

    def misfit(self, entity: Entity, wanted: Types, role: str, at: int) -> None:
        """Note a term that may not fit, or refuse one that does not.

        Args:
            entity: the term, with its types.
            wanted: the types that fit.
            role: what it is there, for messages.
            at: the index of its first token.
        """
        term, types = entity
        found = f"{shown(term)} of type {TypedName('', types).type_text}"
        expected = f"{TypedName('', wanted).type_text} {role}"
        if isinstance(term, Constant) or self.symbols.fit(types, wanted) is Fit.NO:
            self.fail(expected, found, at)
        self.deviate(expected, "it may be one", found, at)

    def term(self) -> Entity:
        """Read a term, nested to any depth.

        Returns:
            The term, and the types of what it denotes.
        """
        if self.tokens[self.at] == "(":
            return finished(self._object_fluent())
        return self._named_term()

    def _named_term(self) -> Entity:
        """Read a variable or an object."""
        token = self.tokens[self.at]
        if token == ")":
            self.fail("a term")
        found = self.variable(token) if token[0] == "?" else self.symbols.object(token)
        if found is None:
            self._unknown_term(token)
        self.at += 1
        return found

    def _unknown_term(self, token: str) -> NoReturn:
        if token[0] != "?":
            names = self.symbols.object_names()
            expected = f"an object that is declared{hint(token, names)}"
            if self.variable(f"?{token}") is not None:
                expected = f"an object, or the variable ?{token}"
            self.fail(expected, f"the object '{token}'")
        names = [f"{entity[0]}" for entity in self.scope.values()]
        expected = f"a variable that is bound here{hint(token, names)}"
        self.fail(expected, f"the variable '{token}'")

    def _object_fluent(self) -> Steps[Entity]:
        signature, start = self.function_here(), self.at
        if signature.parameters is not None and not signature.types:
            self.fail("a term", f"the number ({signature.name} ...)")
        self.at += 2
        terms: list[Term] = []
        declared = signature.parameters is not None
        while self.tokens[self.at] != ")" and not (
            declared and len(terms) == len(signature.accepted)
        ):
            at = self.at
            if self.tokens[at] == "(":
                entity: Entity = yield self._object_fluent()
            else:
                entity = self._named_term()
            if declared:
                self._check_fit(signature, len(terms), entity, at)
            terms.append(entity[0])
        if self.tokens[self.at] != ")" or (declared and len(terms) < len(signature.accepted)):
            self._wrong_number(signature, start, self.at)
        self.at += 1
        return Fluent(signature.name, tuple(terms)), signature.types

    def function_here(self) -> Signature:
        """Look up the function whose parenthesis is the next token.

        Returns:
            The function.
        """
        self.at += 1
        name = self.word("a function")
        self.at -= 2
        return self.known(self.symbols.functions, name)

    def known(self, named: Named, name: str) -> Signature:
        """Look up a predicate or a function.

        Args:
            named: the predicates, or the functions.
            name: the name, which is the token behind the next one.

        Returns:
            It.
        """
        found = named.find(name)
        if found is not None:
            return found
        if self.symbols.unknown_domain and is_name(name, named.kind):
            found = Signature(name, None, ())
            named.add(found)
        else:
            expected = f"a {named.kind} that is declared{hint(name, named.names())}"
            self.fail(expected, f"the {named.kind} '{name}'", self.at + 1)
        return found
