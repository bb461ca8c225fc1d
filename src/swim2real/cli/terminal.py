"""The way of every line to the terminal: nothing from outside colors it, moves its cursor or turns its text.

Tables and progress go through the consoles of `cli.tables`, which show text in the same way. A motor's computer prints
as well, so this file needs nothing but the standard library.
"""

from __future__ import annotations

import json
import logging
import sys
import warnings
from typing import Any

from swimbase.escaping import visible

_format_warning = warnings.formatwarning


def say(text: str) -> None:
    """Prints a text as it is, however long its lines are; characters that aren't seen become codes."""
    print(visible(text))


def say_json(content: Any) -> None:
    """Prints plain content as JSON in ASCII."""
    print(json.dumps(content, indent=2))


def tell(text: str) -> None:
    """Prints a sentence on standard error, after the program's name."""
    print(f"swim2real: {visible(text)}", file=sys.stderr)


class LogLine(logging.Formatter):
    """A line of the log, with its level."""

    def __init__(self) -> None:
        super().__init__("%(levelname)s: %(message)s")

    def format(self, record: logging.LogRecord) -> str:
        """The line, or the lines of a message with a traceback."""
        return visible(super().format(record))


def warning_line(*arguments: Any, **named: Any) -> str:
    """A library's warning as Python prints it, which may name what comes from outside."""
    return visible(_format_warning(*arguments, **named))
