"""Prints what the project depends on: `licenses`, a table of the installed packages, or `lowest`, constraints for pip.

These are the lowest versions that pyproject.toml allows, of the core and of the extras.
"""

from __future__ import annotations

import re
import sys
import tomllib
from importlib.metadata import Distribution, distributions
from itertools import chain
from pathlib import Path

ROOT = Path(__file__).parents[1]


def license_of(package: Distribution) -> str:
    """As its metadata has it: an expression, else its classifiers, else the first line of its text."""
    said = package.metadata
    classes = [line.rpartition(":: ")[2] for line in said.get_all("Classifier", []) if line.startswith("License ::")]
    text = (said.get("License") or "").strip().split("\n")[0][:60]
    return said.get("License-Expression") or ", ".join(classes) or text or "not said"


def licenses() -> list[str]:
    found = sorted({(one.name.lower(), one.version, license_of(one)) for one in distributions()})
    return ["| package | version | license |", "|---|---|---|", *(f"| {' | '.join(row)} |" for row in found)]


def lowest() -> list[str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = chain(project["dependencies"], *project["optional-dependencies"].values())
    bounds = [match.groups() for text in wanted if (match := re.match(r"([\w-]+)(?:\[.*\])?>=([\d.]+)", text))]
    return sorted({f"{name}=={version}" for name, version in bounds})


if __name__ == "__main__":
    print("\n".join({"licenses": licenses, "lowest": lowest}[sys.argv[1]]()))
