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


def lines(text: str) -> int:
    return len(text.splitlines())


def total(folder: str, ending: str, measure: Callable[[str], int]) -> int:
    return sum(measure(path.read_text(encoding="utf-8")) for path in (ROOT / folder).rglob(f"*{ending}"))


def main() -> int:
    ceilings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["surface"]
    sizes = {
        "files": len(list((ROOT / "src").rglob("*.py"))),
        "code_lines": total("src", ".py", code_lines),
        "public_definitions": total("src", ".py", public_definitions),
        "any_dicts": total("src", ".py", lambda text: text.count("dict[str, Any]")),
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
