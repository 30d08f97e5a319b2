"""The kernels' own source, taken apart: plain Python, each operation rounded as one likes.

Nothing is written again: the syntax tree of the product's source is read, decorators and imports
are left out, and each sum, difference, product, quotient and root is handed to a rounding. So the
law can be run in 8 bits as well as in 53, and faults can be planted into its text.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Iterable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

ROUNDED = "rounded_"
_OPERATIONS = (ast.Add, ast.Sub, ast.Mult, ast.Div)


class _Rounding(ast.NodeTransformer):
    """Hand the result of each operation to `ROUNDED`."""

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        return _handed(node) if isinstance(node.op, _OPERATIONS) else node

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        root = isinstance(node.func, ast.Attribute) and node.func.attr == "sqrt"
        return _handed(node) if root else node


def _handed(node: ast.expr) -> ast.expr:
    name = ast.Name(ROUNDED, ast.Load())
    return ast.copy_location(ast.Call(name, [node], []), node)


def source_of(module: str) -> str:
    """The source of a module, which is not imported."""
    spec = find_spec(module)
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError(module)
    return Path(spec.origin).read_text(encoding="utf-8")


def transcribed(
    sources: Iterable[str],
    functions: Iterable[str],
    *,
    constants: Mapping[str, float] | None = None,
    rounding: Any = None,
    compiled: Callable[[Any], Any] | None = None,
) -> dict[str, Any]:
    """Run the definitions of some sources, and return their names.

    Args:
        sources: texts, each of which uses names of those before.
        functions: what is taken of them.
        constants: replaced ones.
        rounding: of each result; None: as Python computes it, IEEE double and no more.
        compiled: what each function is handed to, if anything.
    """
    wanted, replaced = set(functions), dict(constants or {})
    names: dict[str, Any] = {"math": math, "NamedTuple": NamedTuple, **replaced}
    if rounding is not None:
        names[ROUNDED] = rounding
    for source in sources:
        for node in ast.parse(source).body:
            _define(node, names, wanted, replaced, rounds=rounding is not None)
            if compiled is not None and isinstance(node, ast.FunctionDef) and node.name in wanted:
                names[node.name] = compiled(names[node.name])
    return names


def _define(
    node: ast.stmt,
    names: dict[str, Any],
    wanted: set[str],
    replaced: dict[str, float],
    rounds: bool,
) -> None:
    if isinstance(node, ast.FunctionDef):
        if node.name not in wanted:
            return
        node.decorator_list, node.returns = [], None
        for argument in node.args.args:
            argument.annotation = None
        if rounds:
            node = _Rounding().visit(node)
    elif isinstance(node, ast.Assign):
        if any(isinstance(target, ast.Name) and target.id in replaced for target in node.targets):
            return
    elif not isinstance(node, ast.ClassDef):
        return
    module = ast.fix_missing_locations(ast.Module([node], []))
    exec(compile(module, "<kernels>", "exec"), names)
