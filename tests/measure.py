"""Measures the source tree: size, prose, imports, and what the tests cover.

python tests/measure.py [--root FOLDER]

Reads source text only, so it measures any checkout, whatever its layout.
"""

from __future__ import annotations

import argparse
import ast
import io
import json
import re
import sys
import tokenize
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "kant_sql"
MIGRATIONS = "migrations"
COVERAGE = "coverage.json"

SMALL_FILE = 100
LONG_FUNCTION = 40
LONG_MODULE = 700
# `session: the session.`, as a line of a docstring that adds nothing to the name.
EMPTY_LINE = re.compile(r"^\s*(\w+): (?:the |a |an |its )?(.+?)\.?$", re.IGNORECASE)

Graph = dict[str, set[str]]
Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass
class Source:
    """One file of the source tree.

    Attributes:
        name: the dotted name of its module.
        path: where it lies, below the root.
        text: all of it.
        is_package: whether it is an `__init__.py`.
    """

    name: str
    path: Path
    text: str
    is_package: bool

    @cached_property
    def tree(self) -> ast.Module:
        return ast.parse(self.text)

    @cached_property
    def nodes(self) -> list[ast.AST]:
        return list(ast.walk(self.tree))

    @cached_property
    def lines(self) -> int:
        return len(self.text.splitlines())


def read_sources(root: Path, folder: str) -> list[Source]:
    """Read all modules below a folder of the root."""
    sources = []
    for path in sorted((root / folder).rglob("*.py")):
        below = path.relative_to(root)
        is_package = path.name == "__init__.py"
        parts = below.parts[:-1] if is_package else below.with_suffix("").parts
        text = path.read_text(encoding="utf-8")
        sources.append(Source(".".join(parts), below, text, is_package))
    return sources


# Lines


def span(node: ast.stmt | ast.expr) -> int:
    """Return how many lines a node has."""
    return (node.end_lineno or node.lineno) - node.lineno + 1


def import_lines(source: Source) -> int:
    """Count the lines of import statements, those within functions included."""
    return sum(span(node) for node in source.nodes if isinstance(node, ast.Import | ast.ImportFrom))


def docstring(node: ast.AST) -> ast.Constant | None:
    """Return the docstring of a module, class or function, as it stands in the source."""
    if not isinstance(node, ast.Module | ast.ClassDef | Function) or not node.body:
        return None
    first = node.body[0]
    if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
        return first.value if isinstance(first.value.value, str) else None
    return None


def docstrings(source: Source) -> list[ast.Constant]:
    """Return all docstrings of a module."""
    return [text for node in source.nodes if (text := docstring(node)) is not None]


def is_empty(line: str) -> bool:
    """Return whether a line of a docstring only repeats the name it describes."""
    match = EMPTY_LINE.match(line)
    return match is not None and match[1].replace("_", " ").strip().lower() == match[2].lower()


def comment_lines(source: Source) -> int:
    """Count the lines that hold a comment and nothing else."""
    tokens = tokenize.generate_tokens(io.StringIO(source.text).readline)
    return sum(
        token.type == tokenize.COMMENT and not token.line[: token.start[1]].strip()
        for token in tokens
    )


def long_functions(source: Source) -> Iterator[tuple[int, str]]:
    """Yield length and place of each long function; its docstring does not count."""
    for node in source.nodes:
        if isinstance(node, Function):
            text = docstring(node)
            length = span(node) - (span(text) if text is not None else 0)
            if length > LONG_FUNCTION:
                yield length, f"{source.path}:{node.lineno} {node.name}"


# Imports


def imported_names(source: Source) -> Iterator[str]:
    """Yield the absolute dotted names that a module imports, wherever the statement stands."""
    package = source.name if source.is_package else source.name.rpartition(".")[0]
    for node in source.nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            parts = package.split(".")[: 1 - node.level or None] if node.level else []
            base = ".".join([*parts, *([node.module] if node.module else [])])
            yield from (f"{base}.{alias.name}" for alias in node.names)


def module_graph(sources: Iterable[Source]) -> Graph:
    """Return which module imports which, type-checking and function-level imports included."""
    sources = list(sources)
    known = {source.name for source in sources}
    graph: Graph = {}
    for source in sources:
        targets = set()
        for name in imported_names(source):
            # `from a.b import c` imports the module a.b.c where there is one, else a.b.
            module = name
            while module and module not in known:
                module = module.rpartition(".")[0]
            targets.add(module)
        graph[source.name] = targets - {"", source.name}
    return graph


def child(package: str, module: str) -> str | None:
    """Return the entry of a package that a module lies in; None outside the package and for it."""
    prefix = f"{package}."
    if not module.startswith(prefix):
        return None
    return prefix + module.removeprefix(prefix).partition(".")[0]


def sibling_graph(modules: Graph, package: str) -> Graph:
    """Return which entry of a package imports which; a sub-package is one entry."""
    # An import of the package's `__init__` is an import of all that it imports.
    through = {child(package, target) for target in modules.get(package, set())}
    graph: dict[str, set[str | None]] = {}
    for name, targets in modules.items():
        entry = child(package, name)
        if entry is not None:
            found = {child(package, target) for target in targets}
            found |= through if package in targets else set()
            graph[entry] = graph.get(entry, set()) | found
    return {entry: {one for one in found if one} - {entry} for entry, found in graph.items()}


def components(graph: Graph) -> list[set[str]]:
    """Return the strongly connected components, importers after what they import (Tarjan)."""
    order: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[set[str]] = []
    for start in sorted(graph):
        if start in order:
            continue
        work = [(start, iter(sorted(graph[start])))]
        order[start] = low[start] = len(order)
        stack.append(start)
        while work:
            node, targets = work[-1]
            for target in targets:
                if target not in order:
                    order[target] = low[target] = len(order)
                    stack.append(target)
                    work.append((target, iter(sorted(graph[target]))))
                    break
                if target in stack:
                    low[node] = min(low[node], order[target])
            else:
                work.pop()
                if work:
                    low[work[-1][0]] = min(low[work[-1][0]], low[node])
                if low[node] == order[node]:
                    at = stack.index(node)
                    found.append(set(stack[at:]))
                    del stack[at:]
    return found


def floors(graph: Graph) -> int:
    """Return how many floors the imports make; a circle stands on one."""
    floor: dict[str, int] = {}
    for component in components(graph):
        below = {target for node in component for target in graph[node]} - component
        level = 1 + max((floor[target] for target in below), default=0)
        floor |= dict.fromkeys(component, level)
    return max(floor.values(), default=0)


def shortest_way(graph: Graph, start: str, end: str) -> list[str]:
    """Return the shortest way from one node to another, both included; there is one."""
    before: dict[str, str] = {}
    queue = deque([start])
    while end not in before:
        node = queue.popleft()
        for target in sorted(graph[node]):
            if target not in before:
                before[target] = node
                queue.append(target)
    way = [end]
    while way[-1] != start or len(way) == 1:
        way.append(before[way[-1]])
    return way[::-1]


def circles(graph: Graph) -> list[list[str]]:
    """Return the shortest circle through each import that lies on one, each circle once."""
    found: dict[tuple[str, ...], list[str]] = {}
    for component in components(graph):
        inner = {node: graph[node] & component for node in sorted(component)}
        for node, targets in inner.items():
            for target in sorted(targets):
                way = shortest_way(inner, target, node)
                at = way.index(min(way))
                circle = way[at:] + way[:at]
                found.setdefault(tuple(circle), circle)
    return sorted(found.values(), key=lambda circle: (len(circle), circle))


# The report


@dataclass
class Imports:
    """The import graph at one level.

    Attributes:
        nodes: how many modules or rooms there are.
        floors: how many floors they stand on.
        circles: the shortest circle through each import that lies on one.
        components: sets of nodes that all reach each other.
    """

    nodes: int
    floors: int
    circles: list[list[str]]
    components: list[set[str]]

    @classmethod
    def of(cls, graph: Graph) -> Imports:
        tied = [component for component in components(graph) if len(component) > 1]
        return cls(len(graph), floors(graph), circles(graph), tied)


@dataclass
class Measures:
    """What is measured of a source tree.

    Attributes:
        files: files in the package.
        small_files: those of at most 100 lines.
        package_lines: lines of the package.
        lines: lines of the package and the migrations; the next four are of these, too.
        import_lines: lines of import statements.
        docstring_lines: lines of docstrings.
        empty_docstring_lines: those of the kind `session: the session.`.
        comment_lines: lines with only a comment.
        rooms: the import graph of the package's entries.
        modules: the import graph of all modules.
        packages: how many sub-packages there are.
        sibling_circles: the import circles among the entries of one sub-package.
        long_functions: length and place of functions over 40 lines, the longest first.
        long_modules: length and place of modules over 700 lines, the longest first.
        coverage: percentages of lines and branches that the tests run; None without a record.
    """

    files: int
    small_files: int
    package_lines: int
    lines: int
    import_lines: int
    docstring_lines: int
    empty_docstring_lines: int
    comment_lines: int
    rooms: Imports
    modules: Imports
    packages: int = 0
    sibling_circles: list[list[str]] = field(default_factory=list)
    long_functions: list[tuple[int, str]] = field(default_factory=list)
    long_modules: list[tuple[int, str]] = field(default_factory=list)
    coverage: tuple[float, float] | None = None


def read_coverage(root: Path) -> tuple[float, float] | None:
    """Return the percentages of lines and of branches in the record of `make coverage`."""
    record = root / COVERAGE
    if not record.exists():
        return None
    totals = json.loads(record.read_text(encoding="utf-8"))["totals"]
    lines = 100 * totals["covered_lines"] / max(totals["num_statements"], 1)
    branches = 100 * totals["covered_branches"] / max(totals["num_branches"], 1)
    return lines, branches


def measure(root: Path) -> Measures:
    """Measure the source tree below a folder."""
    package = read_sources(root, PACKAGE)
    if not package:
        raise SystemExit(f"measure.py: no Python files in {root / PACKAGE}")
    sources = [*package, *read_sources(root, MIGRATIONS)]
    texts = [text for source in sources for text in docstrings(source)]
    modules = module_graph(package)
    packages = [one.name for one in package if one.is_package and one.name != PACKAGE]
    return Measures(
        files=len(package),
        small_files=sum(source.lines <= SMALL_FILE for source in package),
        package_lines=sum(source.lines for source in package),
        lines=sum(source.lines for source in sources),
        import_lines=sum(import_lines(source) for source in sources),
        docstring_lines=sum(span(text) for text in texts),
        empty_docstring_lines=sum(
            is_empty(line) for text in texts for line in str(text.value).splitlines()
        ),
        comment_lines=sum(comment_lines(source) for source in sources),
        rooms=Imports.of(sibling_graph(modules, PACKAGE)),
        modules=Imports.of(modules),
        packages=len(packages),
        sibling_circles=[
            circle for name in packages for circle in circles(sibling_graph(modules, name))
        ],
        long_functions=sorted(
            (found for source in sources for found in long_functions(source)), reverse=True
        ),
        long_modules=sorted(
            ((s.lines, str(s.path)) for s in sources if s.lines > LONG_MODULE), reverse=True
        ),
        coverage=read_coverage(root),
    )


def row(name: str, value: object, note: str = "") -> str:
    """Return a line of the report."""
    return f"{name:<34}{value:>9}{'  ' if note else ''}{note}"


def circle_lines(found: Iterable[list[str]]) -> Iterator[str]:
    """Yield a line for each circle."""
    for circle in found:
        short = [node.removeprefix(f"{PACKAGE}.") for node in (*circle, circle[0])]
        yield f"    {' > '.join(short)}"


def report(measures: Measures) -> Iterator[str]:
    """Yield the lines of the report."""

    def share(count: int) -> str:
        return f"{100 * count / measures.lines:.1f} %"

    empty = measures.empty_docstring_lines
    yield row(f"files in {PACKAGE}/", measures.files)
    yield row(f"  of at most {SMALL_FILE} lines", measures.small_files)
    yield row(f"lines in {PACKAGE}/", measures.package_lines)
    yield row("  with migrations", measures.lines)
    yield row("    of imports", measures.import_lines, share(measures.import_lines))
    yield row("    of docstrings", measures.docstring_lines, share(measures.docstring_lines))
    yield row("      like `session: the session.`", empty)
    yield row("    of comments", measures.comment_lines, share(measures.comment_lines))
    yield row(f"functions over {LONG_FUNCTION} lines", len(measures.long_functions))
    yield from (f"  {length:>5}  {place}" for length, place in measures.long_functions)
    yield row(f"modules over {LONG_MODULE} lines", len(measures.long_modules))
    yield from (f"  {length:>5}  {place}" for length, place in measures.long_modules)
    for name, imports in (("rooms", measures.rooms), ("modules", measures.modules)):
        yield row(name, imports.nodes)
        sizes = ", ".join(str(len(component)) for component in imports.components)
        note = f"strongly connected: {sizes} {name}" if imports.components else ""
        yield row("  import floors", imports.floors)
        yield row("  import circles", len(imports.circles), note)
        yield from circle_lines(imports.circles)
    yield row("sub-packages", measures.packages)
    yield row("  import circles of siblings", len(measures.sibling_circles))
    yield from circle_lines(measures.sibling_circles)
    if measures.coverage is None:
        yield row("coverage", "unknown", "`make coverage` records it")
    else:
        lines, branches = measures.coverage
        yield row("coverage of lines", f"{lines:.1f} %")
        yield row("coverage of branches", f"{branches:.1f} %")


def main(argv: list[str]) -> int:
    """Print the measures of this or another checkout."""
    parser = argparse.ArgumentParser(prog="measure.py", description="Measure the source tree.")
    parser.add_argument(
        "--root", type=Path, default=ROOT, metavar="FOLDER", help="the checkout (this one)"
    )
    for line in report(measure(parser.parse_args(argv).root)):
        print(line)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
