"""Mutants drawn at random by the syntax tree: an operator, a comparison, a number, a statement, a returned value.

Docstrings and other texts, annotations, imports and what only a type checker runs are never changed. A statement is
dropped only where no name would be missing then, which any test that runs the line would notice.
"""

from __future__ import annotations

import ast
import random
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

ARITHMETIC = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
    ast.FloorDiv: ("//", "/"),
    ast.Mod: ("%", "*"),
    ast.Pow: ("**", "*"),
    ast.LShift: ("<<", ">>"),
    ast.RShift: (">>", "<<"),
    ast.BitAnd: ("&", "|"),
    ast.BitOr: ("|", "&"),
    ast.BitXor: ("^", "&"),
}
COMPARED: dict[type[ast.cmpop], tuple[str, tuple[str, ...]]] = {
    ast.Lt: ("<", ("<=", ">=")),
    ast.LtE: ("<=", ("<", ">")),
    ast.Gt: (">", (">=", "<=")),
    ast.GtE: (">=", (">", "<")),
    ast.Eq: ("==", ("!=",)),
    ast.NotEq: ("!=", ("==",)),
    ast.Is: ("is", ("is not",)),
    ast.IsNot: (r"is\s+not", ("is",)),
    ast.In: ("in", ("not in",)),
    ast.NotIn: (r"not\s+in", ("in",)),
}
_BLOCKS = ("body", "orelse", "finalbody", "handlers", "cases")
_TYPES = ("annotation", "returns", "pattern", "type_comment", "type_params")
_NEVER = (ast.Import, ast.ImportFrom, ast.Pass, ast.Global, ast.Nonlocal)
_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


@dataclass(frozen=True)
class Place:
    """A statement and where it stands: names of function and classes around it, and names bound before it there."""

    file: str
    statement: ast.stmt
    inside: tuple[str, ...]
    bound: frozenset[str] | None


@dataclass(frozen=True)
class Edit:
    """Bytes `start` to `end` of a source replaced by `text`.

    Attributes
    ----------
    lines : tuple of int
        That of the statement and its own; none where it runs when the module is imported, for whichever test it is.
    """

    kind: str
    file: str
    lines: tuple[int, ...]
    inside: tuple[str, ...]
    start: int
    end: int
    text: str

    def applied(self, source: str) -> str:
        """Return the source with the error in it."""
        data = source.encode()
        return (data[: self.start] + self.text.encode() + data[self.end :]).decode()


def drawn(sources: Mapping[str, str], seed: int, count: int) -> list[Edit]:
    """Return so many mutants, each of another statement; every statement is equally probable, and so is every kind."""
    rng = random.Random(seed)
    places = [place for file, source in sorted(sources.items()) for place in places_of(file, ast.parse(source))]
    rng.shuffle(places)
    found: list[Edit] = []
    for place in places:
        if len(found) == count:
            break
        if edits := list(Finder(place, sources[place.file], rng).edits()):
            kind = rng.choice(sorted({edit.kind for edit in edits}))
            edit = rng.choice([edit for edit in edits if edit.kind == kind])
            found += [edit] if _is_source(edit.applied(sources[place.file])) else []
    return found


def places_of(file: str, tree: ast.Module) -> Iterator[Place]:
    """Yield the statements that may be changed."""
    yield from _places(file, tree.body, (), None)


def _places(file: str, body: list[ast.stmt], inside: tuple[str, ...], bound: set[str] | None) -> Iterator[Place]:
    for node in body:
        if isinstance(node, _NEVER) or "__all__" in _names([node]):
            continue
        only_types = isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING")
        if not only_types:
            yield Place(file, node, inside, None if bound is None else frozenset(bound))
        around, known = inside, bound
        if isinstance(node, (*_FUNCTIONS, ast.ClassDef)):
            around = (*inside, node.name)
            known = _arguments(node) if isinstance(node, _FUNCTIONS) else None
        for block in ("orelse",) if only_types else _BLOCKS:
            for part in getattr(node, block, []):
                inner = [part] if isinstance(part, ast.stmt) else part.body
                yield from _places(file, inner, around, known)
        if bound is not None:
            bound |= _names([node])


def _arguments(function: ast.FunctionDef | ast.AsyncFunctionDef) -> set[str]:
    return {node.arg for node in ast.walk(function.args) if isinstance(node, ast.arg)}


def _names(nodes: list[ast.stmt]) -> set[str]:
    """Return the names that statements bind."""
    every = (node for one in nodes for node in ast.walk(one))
    return {node.id for node in every if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}


def _is_source(text: str) -> bool:
    try:
        ast.parse(text)
    except SyntaxError:
        return False
    return True


class Finder:
    """Finds the edits of one statement, without those of the statements in it."""

    def __init__(self, place: Place, source: str, rng: random.Random) -> None:
        self._place, self._rng = place, rng
        self._data = source.encode()
        self._starts = [0]
        for line in self._data.split(b"\n"):
            self._starts.append(self._starts[-1] + len(line) + 1)

    def edits(self) -> Iterator[Edit]:
        """Yield every edit of the statement; of two that a place allows, one is drawn."""
        node = self._place.statement
        if self._place.bound is not None and _may_be_dropped(node, self._place.bound):
            yield self._edit("statement", node, *self._span(node), "pass")
        if isinstance(node, ast.Return) and node.value is not None and ast.unparse(node.value) != "None":
            yield self._edit("returned value", node, *self._span(node.value), "None")
        if isinstance(node, ast.AugAssign) and type(node.op) in ARITHMETIC:
            old, new = ARITHMETIC[type(node.op)]
            yield from self._between("operator", node.target, node.value, re.escape(old) + "=", new + "=")
        for part in _own_parts(node):
            yield from self._of_expression(part)

    def _of_expression(self, node: ast.AST) -> Iterator[Edit]:
        if isinstance(node, ast.BinOp) and type(node.op) in ARITHMETIC and not _is_text(node.left, node.right):
            old, new = ARITHMETIC[type(node.op)]
            yield from self._between("operator", node.left, node.right, re.escape(old), new)
        elif isinstance(node, ast.Compare):
            for left, operator, right in zip([node.left, *node.comparators], node.ops, node.comparators, strict=False):
                old, instead = COMPARED[type(operator)]
                yield from self._between("comparison", left, right, old, self._rng.choice(instead))
        elif isinstance(node, ast.BoolOp):
            old, new = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
            for left, right in zip(node.values, node.values[1:], strict=False):
                yield from self._between("comparison", left, right, old, new)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
            start = self._span(node)[0]
            kind, length = ("comparison", 3) if isinstance(node.op, ast.Not) else ("operator", 1)
            yield self._edit(kind, node, start, start + length, "")
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
            changed = node.value + 1 if isinstance(node.value, int) else node.value * 2 or 1.0
            yield self._edit("number", node, *self._span(node), repr(changed))

    def _between(self, kind: str, left: ast.expr, right: ast.expr, old: str, new: str) -> Iterator[Edit]:
        begin, end = self._span(left)[1], self._span(right)[0]
        gap = self._data[begin:end].decode()
        found = re.search(old, gap)
        if found is not None and "#" not in gap:
            yield self._edit(kind, left, begin + found.start(), begin + found.end(), new)

    def _edit(self, kind: str, node: ast.expr | ast.stmt, start: int, end: int, text: str) -> Edit:
        lines = () if self._place.bound is None else (self._place.statement.lineno, node.lineno)
        while text == "" and self._data[end : end + 1] == b" ":
            end += 1
        return Edit(kind, self._place.file, lines, self._place.inside, start, end, text)

    def _span(self, node: ast.expr | ast.stmt) -> tuple[int, int]:
        assert node.end_lineno is not None and node.end_col_offset is not None
        start = self._starts[node.lineno - 1] + node.col_offset
        return start, self._starts[node.end_lineno - 1] + node.end_col_offset


def _may_be_dropped(node: ast.stmt, bound: Collection[str]) -> bool:
    if isinstance(node, ast.Expr):
        return not isinstance(node.value, ast.Constant)
    if isinstance(node, ast.AugAssign | ast.Raise | ast.Continue | ast.Break | ast.Delete):
        return True
    return isinstance(node, ast.Assign | ast.AnnAssign) and _names([node]) <= set(bound)


def _is_text(*nodes: ast.expr) -> bool:
    return any(
        isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str | bytes))
        for node in nodes
    )


def _own_parts(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the expressions of a statement, without its blocks, types and texts."""
    for name, value in ast.iter_fields(node):
        if name in _TYPES or (name in _BLOCKS and isinstance(node, ast.stmt | ast.ExceptHandler)):
            continue
        for part in value if isinstance(value, list) else [value]:
            if isinstance(part, ast.AST) and not isinstance(part, ast.JoinedStr):
                if isinstance(part, ast.expr):
                    yield part
                yield from _own_parts(part)
