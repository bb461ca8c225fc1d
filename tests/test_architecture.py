"""The page on architecture names every package, and every module directly below swim2real."""

import re
from pathlib import Path

import swim2real

SOURCE = Path(swim2real.__file__).parent
PAGE = (Path(__file__).parents[1] / "docs" / "architecture.md").read_text(encoding="utf-8")


def test_the_tree_names_what_exists():
    named = set(re.findall(r"^  ([a-z_]+(?:/|\.py)) ", PAGE, flags=re.MULTILINE))
    packages = {f"{path.parent.name}/" for path in SOURCE.glob("*/__init__.py")}
    assert named == packages | {path.name for path in SOURCE.glob("*.py")} - {"__main__.py"}
    inner = {path.parent.name for path in SOURCE.glob("*/*/__init__.py")}
    assert sorted(name for name in inner if f"{name}/" not in PAGE) == []
