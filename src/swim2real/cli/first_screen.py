"""The first screen of a command's help: the options that nine of ten need, and the names of the others."""

from __future__ import annotations

import contextlib
import io
import os
import re
import textwrap
from collections.abc import Callable

LINES = 24
_WIDTH = 80
_WHOLE = 100  # characters of a line of the help that is read
_INDENT = 24
_UNSAID = re.compile(r" *\(default: (None|False)?\)")
_ITEM = re.compile(r"^  (--?[a-z].*?|[A-Z{\[][A-Z|{}\]\[. ]*)(?: {2,}(\S.*))?$")
EVERYDAY = {
    "calibrate": "--out --robot --resume --hold-out --budget --minutes --seed --horizon --quiet --verbose",
    "compare": "--out --methods --seeds --budget --workers --parameters",
    "deploy": "--dry-run --motors --port --log --clip",
    "ensemble": "--reference --out --within --count",
    "evaluate": "--reference --robot --protocol --horizon --json",
    "export-commands": "--out --seconds --goal --which",
    "identify": "--reference --robot --again --quiet",
    "import-recording": "--robot --to --time --controls --sensors --markers",
    "import-tracks": "--to --fps --robot --camera --controls",
    "next": "--reference --robot --out",
    "overlay": "--reference --out --robot --video --camera",
    "pick": "--robot --midline --fps",
    "quality": "--robot --allow-lost --plot",
    "rollout": "--episodes --goals --out --closed-loop --no-film",
    "simulate": "--frequency --out --robot --seconds --from-rest",
    "track": "--to --markers --robot --controls --camera --frequency",
    "train": "--parameters --out --env-steps --ensemble --environments --resume",
    "view": "--reference --trial --film --frequency --robot",
}  # options, the most needed ones first, of the commands whose whole help is longer


def captured(show: Callable[[], object]) -> str:
    """The whole help of a command, as what shows it prints it."""
    text, before = io.StringIO(), os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = str(_WHOLE)
    try:
        with contextlib.redirect_stdout(text), contextlib.suppress(SystemExit):
            show()
    finally:
        if before is None:
            del os.environ["COLUMNS"]
        else:
            os.environ["COLUMNS"] = before
    return text.getvalue()


def first_screen(name: str, whole: str) -> str:
    """The first screen of a command's help.

    Args:
        name: Name of the command.
        whole: Its whole help, with one option after the other.
    """
    head, *parts = whole.split("\n\n")
    items = dict[str, list[str]]()
    for line in "\n\n".join(parts[1:]).splitlines():
        if found := _ITEM.match(line):
            items[found[1].strip()] = [found[2] or ""]
        elif line.startswith("    ") and items:
            next(reversed(items.values())).append(line.strip())
    texts = {item: _UNSAID.sub("", " ".join(" ".join(lines).split())) for item, lines in items.items()}
    options = {item: re.findall(r"--[\w-]+", item) for item in texts if not item.startswith("-h")}
    wanted = EVERYDAY[name].split() if name in EVERYDAY else [one for names in options.values() for one in names]
    shown = [item for item, names in options.items() if not names]
    shown += [item for option in wanted for item, names in options.items() if option in names and item not in shown]
    others = [names[0] for item, names in options.items() if item not in shown]
    more = textwrap.wrap(f"More: {' '.join(others)}", _WIDTH, break_on_hyphens=False) if others else []
    last = [*more, f"swim2real {name} --help-all explains every option."]
    lines = [" ".join(head.split()), "", *textwrap.wrap(parts[0], _WIDTH), ""]
    for number, item in enumerate(shown):
        room = LINES - len(lines) - len(last) - (len(shown) - number - 1)
        said = next((option for option in wanted if option in options[item]), item)
        lines += _explained(item if len(item) < _INDENT - 3 else said, texts[item], room)
    return "\n".join([*lines, *last])


def _explained(item: str, text: str, most: int) -> list[str]:
    """An option with as many whole sentences of its help as so many lines hold, the first one at least."""
    sentences = re.split(r"(?<=[.)]) (?=[A-Z(`]|\w+:)", text)
    lines = [""]
    for count in range(len(sentences), 0, -1):
        lines = textwrap.wrap(" ".join(sentences[:count]), _WIDTH - _INDENT, break_on_hyphens=False)
        if len(lines) <= min(most, 2):
            break
    return [f"{f'  {item}' if k == 0 else '':<{_INDENT}}{line}" for k, line in enumerate(lines or [""])]
