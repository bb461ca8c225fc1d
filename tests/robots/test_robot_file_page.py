"""The page that explains a robot file has every key that its readers take."""

import re
from pathlib import Path

import pytest

import swim2real.robots

ROOMS = Path(swim2real.robots.__file__).parent
PAGE = (Path(__file__).parents[2] / "docs" / "robot-file.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("module", ["file", "trial_table", "calibrated"])
def test_every_key_is_explained(module):
    source = (ROOMS / f"{module}.py").read_text(encoding="utf-8")
    lists = re.findall(r"(?:\.allow|_KEYS =) ?\(([^)]*)\)", source)
    keys = set(re.findall(r'"(\w+)"', " ".join(lists)))
    assert len(keys) > 3
    assert sorted(key for key in keys if not re.search(rf"\b{key}\b", PAGE)) == []
