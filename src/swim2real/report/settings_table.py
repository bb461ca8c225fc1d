"""Settings, versions, engine and fingerprints: what a result needs to be told apart from another."""

from __future__ import annotations

import json
from typing import Any, cast

from swim2real.report.run import ReportedRun
from swim2real.report.units import significant

_LABELS = {
    "robot": "Robot",
    "robot_file": "Robot file",
    "robot_fingerprint": "Robot fingerprint (sha256)",
    "method": "Method",
    "advisor": "Advisor",
    "protocol": "Protocol",
    "budget": "Budget (evaluations)",
    "seed": "Seed",
    "scale": "Scale of the search",
    "early_stop": "Early stop of rejected steps",
    "horizon": "Horizon (s compared of each trial)",
    "hold_out": "Held-out trials",
    "reference": "Reference",
    "reference_fingerprint": "Reference fingerprint (sha256)",
    "commit": "Commit",
    "created": "Begun",
}
_APART = ("format", "engine", "versions")
_SHOWN_NUMBERS = 3


def settings_rows(run: ReportedRun) -> tuple[tuple[str, str], ...]:
    """Every setting as label and text; those that this version doesn't know under their own names."""
    known = [name for name in _LABELS if name in run.settings]
    apart = (*_APART, *run.sections.unused)
    others = [name for name in run.settings if name not in _LABELS and name not in apart]
    rows = [(_LABELS.get(name, name), _text(run.settings[name])) for name in (*known, *others)]
    return (
        *rows,
        *(_prefixed("Engine", run.settings.get("engine"))),
        *_prefixed("Version", run.settings.get("versions")),
    )


def _prefixed(prefix: str, content: Any) -> list[tuple[str, str]]:
    if not isinstance(content, dict):
        return [] if content is None else [(prefix, _text(content))]
    entries = cast(dict[str, Any], content)
    return [(f"{prefix}: {name.replace('_', ' ')}", _text(value)) for name, value in entries.items()]


def _text(value: Any) -> str:
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        items = cast(list[Any], value)
        if items and all(isinstance(one, float) for one in items):
            shown = ", ".join(significant(one) for one in items[:_SHOWN_NUMBERS])
            return shown if len(items) <= _SHOWN_NUMBERS else f"{shown}, … ({len(items)} numbers)"
        return ", ".join(_text(one) for one in items) or "none"
    if isinstance(value, dict):
        return json.dumps(value, ensure_ascii=False)
    return significant(value) if isinstance(value, float) else str(value)
