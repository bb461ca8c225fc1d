"""Tables and briefings in Markdown, with hostile names and texts: a reader of Markdown finds only text in them."""

from collections.abc import Iterator
from dataclasses import replace

import pytest
from markdown_it import MarkdownIt
from markdown_it.token import Token

from made_results import two_methods
from swim2real.comparison.tables import Cell, Table, all_tables, as_markdown

ATTACKS = (
    "<script>alert(1)</script>", "<img src=http://x/p.png onerror=alert(1)>", "![p](http://x/p.png)",
    "[a](javascript:alert(1))", "[a][b]\n\n[b]: http://x",
    "<http://x>", "`code` | cell", "**bold** _it_ ~~gone~~", "first\n\n# heading\n- item",
    "&lt;b&gt;", "\\](http://x)", "\\<b>", "a\u202eb\x1b[31m", "<!-- hidden", "![p][q]\n[q]: http://x/p.png",
)  # fmt: skip
ONLY = {"table", "thead", "tbody", "tr", "th", "td", "heading", "paragraph", "inline", "text", "strong", "softbreak"}


def pieces(tokens: list[Token]) -> Iterator[Token]:
    for token in tokens:
        yield token
        yield from pieces(token.children or [])


def parsed(text: str) -> tuple[set[str], str]:
    """What a text in Markdown consists of, and its words."""
    found = list(pieces(MarkdownIt("commonmark", {"html": True}).enable(["table", "strikethrough"]).parse(text)))
    kinds = {token.type.removesuffix("_open").removesuffix("_close") for token in found}
    return kinds, "".join(token.content for token in found if token.type in ("text", "text_special"))


@pytest.mark.parametrize("attack", ATTACKS)
def test_tables_are_only_tables(attack: str) -> None:
    cells = (Cell(attack), Cell(attack, 1.0, is_best=True))
    kinds, words = parsed(as_markdown(Table("t", attack, ("Method", attack, "b"), ((attack, cells),), "note")))
    assert kinds <= ONLY | {"text_special"}
    assert kinds >= {"table", "strong"}
    plain = attack.split("\n")[0].split("\u202e")[0]
    assert words.count(plain) == 5
    results = two_methods()
    runs = tuple(replace(run, method=f"{run.method} {attack}") for run in results.runs)
    hostile = replace(results, runs=runs, methods=tuple(f"{method} {attack}" for method in results.methods))
    assert parsed(all_tables(hostile))[0] <= ONLY | {"text_special"}
