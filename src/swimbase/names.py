"""Names from outside, and their limits.

A **file name** becomes part of a path: that of a trial, or of a folder made of one. It is good on every system. A
**label** is only shown: of a robot, marker, parameter, joint, actuator, sensor, column, or a unit. Both are a line of
characters that are seen. Anything longer, such as a description or a VLM's answer, is free text; `escaping` shows it.
"""

from __future__ import annotations

import unicodedata
from functools import lru_cache

from swimbase.escaping import is_seen, visible

LONGEST = 200  # characters of a label, bytes of a file name: systems take 255 with an ending
RESERVED = '<>:"/\\|?*'
_PORTS = {f"{port}{number}" for port in ("com", "lpt") for number in "0123456789¹²³"}
_DEVICES = {"con", "prn", "aux", "nul", "clock$", "conin$", "conout$", *_PORTS}
_SHOWN = 60  # characters of a wrong name


@lru_cache(4096)
def label_fault(name: str) -> str | None:
    """Why a text can't be a label, as a clause that follows it; None where it can."""
    if not name.strip():
        return "is blank; it must have a character that is seen"
    if len(name) > LONGEST:
        return f"has {len(name)} characters; it must have at most {LONGEST}"
    hidden = next((character for character in name if not is_seen(character)), None)
    if hidden is not None:
        return f"has the character {_code(hidden)}, which isn't seen; it must be letters, digits, signs and spaces"
    return None


@lru_cache(4096)
def file_name_fault(name: str) -> str | None:
    """Why a text can't be the name of a file, an ending apart, on every system; None where it can."""
    fault = label_fault(name)
    if fault is not None:
        return fault
    # a fullwidth slash is a slash to some systems
    reserved = next(
        (character for character in name if set(unicodedata.normalize("NFKC", character)) & set(RESERVED)), ""
    )
    if reserved:
        return f"has the character {reserved}; it must have none of {' '.join(RESERVED)}"
    if name != name.strip() or name[0] == "." or name[-1] == ".":
        return "begins or ends with a dot or a space; it must not"
    if name.split(".")[0].rstrip().casefold() in _DEVICES:
        return "is the name of a device on some systems; it must be another"
    size = len(composed(name).encode())
    if size > LONGEST:
        return f"has {size} bytes in UTF-8; it must have at most {LONGEST}"
    return None


def composed(name: str) -> str:
    """A name in the Unicode form in which an umlaut is one character (NFC). Names with the same one are the same."""
    return unicodedata.normalize("NFC", name)


def file_key(name: str) -> str:
    """Key that two names share if some system takes them for one: the same letters in another form or case."""
    return composed(name).casefold()


def quoted(name: str) -> str:
    """A name for a message: in quotes, with codes for what isn't seen, cut off where it gets long."""
    shown = visible(name).replace("\n", "\\n").replace("\t", "\\t")
    return f"'{shown}'" if len(shown) <= _SHOWN else f"'{shown[: _SHOWN - 1]}…'"


def _code(character: str) -> str:
    return f"U+{ord(character):04X}"
