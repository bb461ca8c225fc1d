"""Pages are complete as files, name what exists, and explain every key of a robot file."""

import importlib.util
import re
from pathlib import Path

from swim2real.robots import schema

PROJECT = Path(__file__).parents[1]
DOCS = PROJECT / "docs"
ARCHITECTURE, ROBOT_FILE = ((DOCS / name).read_text("utf-8") for name in ("architecture.md", "robot-file.md"))
spec = importlib.util.spec_from_file_location("hooks", DOCS / "hooks.py")
hooks = importlib.util.module_from_spec(spec)
spec.loader.exec_module(hooks)


def test_the_written_parts_are_those_of_the_code():
    pages = {path.name: path.read_text("utf-8") for path in DOCS.rglob("*.md")}
    emptied = {name: hooks.WRITTEN.sub(r"\1\3", text) for name, text in pages.items()}
    assert {name for name in pages if emptied[name] != pages[name]} == {"concepts.md", "first-calibration.md"}
    assert {name: hooks.current(text) for name, text in emptied.items()} == pages, "run `python docs/hooks.py`"


def test_the_tree_names_what_exists_and_each_package_has_a_readme():
    named = set(re.findall(r"^(?:  |src/)([a-z0-9_]+(?:/|\.py)) ", ARCHITECTURE, flags=re.MULTILINE)) | {"swim2real/"}
    source = PROJECT / "src"
    packages = {f"{path.parent.name}/" for pattern in ("*", "*/*") for path in source.glob(f"{pattern}/__init__.py")}
    modules = {path.name for path in (source / "swim2real").glob("*.py")} - {"__init__.py", "__main__.py"}
    assert named == packages | modules
    inner = {path.parent.name for path in source.glob("*/*/*/__init__.py")}
    assert sorted(name for name in inner if f"{name}/" not in ARCHITECTURE) == []
    packages = {path.parent for path in (PROJECT / "src").glob("*/__init__.py")} - {PROJECT / "src" / "swimbase"}
    assert [package.name for package in packages if not (package / "README.md").is_file()] == []


TABLES = {
    "The robot": (schema.RobotTable, schema.MarkerTable), "Recordings": (schema.RecordingsTable, schema.SensorTable),
    "Swims": (schema.SwimsTable,), "Policies": (schema.PolicyTable, schema.CommandTable),
    "Parameters": (schema.ParameterTable, schema.TargetTable),
}  # fmt: skip


def explained(section: str) -> set[str]:
    """Keys in the first column of a section's tables."""
    text = ROBOT_FILE.split(f"\n## {section}\n")[1].split("\n## ")[0]
    tables = re.findall(r"^\| key \|.*\n\|.*\n((?:\|.*\n)+)", text + "\n", flags=re.MULTILINE)
    cells = [row.split("|")[1] for table in tables for row in table.splitlines()]
    return set(re.findall(r"`\[*(\w+)\]*`", " ".join(cells)))


def test_every_key_is_explained_and_no_other():
    for section, models in TABLES.items():
        keys = {key for model in models for key in model.model_fields}
        assert explained(section) - {"extends"} == keys, section  # what extends is resolved before the check
    assert all(f"{key} = " in ROBOT_FILE for key in schema.SineTable.model_fields)
