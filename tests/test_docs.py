"""Pages are complete as files: what the code decides stands in them as `python docs/hooks.py` writes it."""

import importlib.util
from pathlib import Path

DOCS = Path(__file__).parents[1] / "docs"
spec = importlib.util.spec_from_file_location("hooks", DOCS / "hooks.py")
hooks = importlib.util.module_from_spec(spec)
spec.loader.exec_module(hooks)


def test_the_written_parts_are_those_of_the_code():
    pages = {path.name: path.read_text("utf-8") for path in DOCS.rglob("*.md")}
    emptied = {name: hooks.WRITTEN.sub(r"\1\3", text) for name, text in pages.items()}
    assert {name for name in pages if emptied[name] != pages[name]} == {"concepts.md", "first-calibration.md"}
    assert {name: hooks.current(text) for name, text in emptied.items()} == pages, "run `python docs/hooks.py`"
