"""The page that explains a robot file has the keys that its models have, no more and no less."""

import re
from pathlib import Path

from swim2real.robots import schema

PAGE = (Path(__file__).parents[2] / "docs" / "robot-file.md").read_text(encoding="utf-8")
TABLES = {
    "The robot": (schema.RobotTable, schema.MarkerTable), "Recordings": (schema.RecordingsTable, schema.SensorTable),
    "Swims": (schema.SwimsTable,), "Policies": (schema.PolicyTable, schema.CommandTable),
    "Parameters": (schema.ParameterTable, schema.TargetTable),
}  # fmt: skip


def explained(section: str) -> set[str]:
    """Keys in the first column of a section's tables."""
    text = PAGE.split(f"\n## {section}\n")[1].split("\n## ")[0]
    tables = re.findall(r"^\| key \|.*\n\|.*\n((?:\|.*\n)+)", text + "\n", flags=re.MULTILINE)
    cells = [row.split("|")[1] for table in tables for row in table.splitlines()]
    return set(re.findall(r"`\[*(\w+)\]*`", " ".join(cells)))


def test_every_key_is_explained_and_no_other():
    for section, models in TABLES.items():
        keys = {key for model in models for key in model.model_fields}
        assert explained(section) - {"extends"} == keys, section  # what extends is resolved before the check
    assert all(f"{key} = " in PAGE for key in schema.SineTable.model_fields)
