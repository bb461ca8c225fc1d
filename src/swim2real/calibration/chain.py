"""Hashes that chain the lines of a record, so that one that was edited or cut is told from one that was written.

A line's hash covers its content and the hash before it, and so all lines above. It leaves out how long the evaluation
took, so that equal runs have equal hashes. It finds what an editor, a script or a disk has changed; it is no signature,
since whoever changes a line can work the hashes out again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any

CHAIN = "chain"
EDITED = "edited"  # key of a line that was taken as it is, though its hash didn't fit
_LEFT_OUT = ("seconds", CHAIN)


def next_hash(before: str, entry: Mapping[str, Any]) -> str:
    """Hash of a line.

    Args:
        before: Hash of the line before it; empty for the first one.
        entry: Content of the line, with its hash or without.
    """
    content = json.dumps({key: value for key, value in entry.items() if key not in _LEFT_OUT})
    return hashlib.sha256((before + content).encode()).hexdigest()


def last_hash(entries: Sequence[Mapping[str, Any]]) -> str:
    """Hash of the last line, worked out for the lines above that have none; empty without a line."""
    last = ""
    for entry in entries:
        last = str(entry.get(CHAIN) or next_hash(last, entry))
    return last


def broken_links(entries: Sequence[Mapping[str, Any]], all_chained: bool) -> list[int]:
    """Indices of the lines whose hash doesn't fit their content and the line before.

    Args:
        entries: Content of all lines, with their hashes.
        all_chained: Whether every line must have a hash. Without, those above the first one that has need none: an
            earlier version wrote them, and that first hash covers them.
    """
    broken: list[int] = []
    last = ""
    for index, entry in enumerate(entries):
        fitting = next_hash(last, entry)
        if CHAIN not in entry and not all_chained:
            last = fitting
            continue
        all_chained = True
        if entry.get(CHAIN) != fitting:
            broken.append(index)
        last = str(entry.get(CHAIN) or fitting)
    return broken


def chained(entries: Sequence[Mapping[str, Any]], edited: Sequence[int]) -> list[dict[str, Any]]:
    """The lines with hashes that fit.

    Args:
        entries: Content of the lines.
        edited: Indices of the lines that get a note that they were edited.
    """
    linked: list[dict[str, Any]] = []
    last = ""
    for index, entry in enumerate(entries):
        content = {key: value for key, value in entry.items() if key != CHAIN}
        if index in edited:
            content[EDITED] = True
        last = next_hash(last, content)
        linked.append({**content, CHAIN: last})
    return linked
