"""Prints how large the project is, and fails above the ceilings in pyproject.toml, [tool.surface].

A change that needs more takes something away, or raises the number in the same commit with the reason.
"""

from __future__ import annotations

import ast
import io
import sys
import tokenize
import tomllib
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).parents[1]
NO_CODE = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}


def code_lines(text: str) -> int:
    """Lines without docstrings, comments and blanks."""
    documented: set[int] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            documented.update(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    written = {line for t in tokens if t.type not in NO_CODE for line in range(t.start[0], t.end[0] + 1)}
    return len(written - documented)


def public_definitions(text: str) -> int:
    """Functions and classes of a module whose names have no underscore in front."""
    named = [node for node in ast.parse(text).body if isinstance(node, ast.ClassDef | ast.FunctionDef)]
    return sum(not node.name.startswith("_") for node in named)


def constants(text: str) -> int:
    """Numeric constants of a module that have a name, in a tuple each one."""
    count = 0
    for node in ast.parse(text).body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None and _numeric(node.value):
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            named = target.elts if isinstance(target, ast.Tuple) else [target]
            count += sum(isinstance(name, ast.Name) and name.id.isupper() for name in named)
    return count


def _numeric(node: ast.expr) -> bool:
    if isinstance(node, ast.Tuple | ast.List):
        return bool(node.elts) and all(map(_numeric, node.elts))
    if isinstance(node, ast.BinOp):
        return _numeric(node.left) and _numeric(node.right)
    if isinstance(node, ast.UnaryOp):
        return _numeric(node.operand)
    return isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool)


def lines(text: str) -> int:
    return len(text.splitlines())


def total(folder: str, ending: str, measure: Callable[[str], int]) -> int:
    return sum(measure(path.read_text(encoding="utf-8")) for path in (ROOT / folder).rglob(f"*{ending}"))


def main() -> int:
    ceilings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["surface"]
    sizes = {
        "files": len(list((ROOT / "src").rglob("*.py"))),
        "code_lines": total("src", ".py", code_lines),
        "swim2real_lines": total("src/swim2real", ".py", code_lines),
        "public_definitions": total("src", ".py", public_definitions),
        "any_dicts": total("src", ".py", lambda text: text.count("dict[str, Any]")),
        "named_constants": total("src", ".py", constants),
        "test_lines": total("tests", ".py", lines),
        "docs_lines": total("docs", ".md", lines),
        "readme_lines": lines((ROOT / "README.md").read_text(encoding="utf-8")),
    }
    above = [name for name, size in sizes.items() if size > ceilings[name]]
    for name, size in sizes.items():
        print(f"{name:20}{size:8}{ceilings[name]:8}{'  above its ceiling' if name in above else ''}")
    if above:
        print("take something away, or raise the number in pyproject.toml, [tool.surface], with the reason")
    return bool(above)


if __name__ == "__main__":
    sys.exit(main())
