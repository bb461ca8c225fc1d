"""The page on architecture names every package of src, every room of it, and every module directly below swim2real."""

import re
from pathlib import Path

PROJECT = Path(__file__).parents[1]
PAGE = (PROJECT / "docs" / "architecture.md").read_text(encoding="utf-8")


def test_the_tree_names_what_exists_and_each_package_has_a_readme():
    named = set(re.findall(r"^(?:  |src/)([a-z0-9_]+(?:/|\.py)) ", PAGE, flags=re.MULTILINE)) | {"swim2real/"}
    source = PROJECT / "src"
    packages = {f"{path.parent.name}/" for pattern in ("*", "*/*") for path in source.glob(f"{pattern}/__init__.py")}
    modules = {path.name for path in (source / "swim2real").glob("*.py")} - {"__init__.py", "__main__.py"}
    assert named == packages | modules
    inner = {path.parent.name for path in source.glob("*/*/*/__init__.py")}
    assert sorted(name for name in inner if f"{name}/" not in PAGE) == []
    packages = {path.parent for path in (PROJECT / "src").glob("*/__init__.py")} - {PROJECT / "src" / "swimbase"}
    assert [package.name for package in packages if not (package / "README.md").is_file()] == []
