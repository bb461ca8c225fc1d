"""Text from outside, made fit to be shown: characters that aren't seen as codes, and Markdown that stays text.

HTML is escaped by the templates of `report`, which use `visible` as well, and by `tracking.pages`; a page runs its own
script alone. A terminal gets text through `cli.terminal`.
"""

from __future__ import annotations

import base64
import hashlib
import re
import unicodedata

_KEPT = "\n\t"
_HTML, _LINK = re.compile(r"<(?=[A-Za-z/!?])"), re.compile(r"\](?=\()")
_ADDRESS = re.compile(r"^( {0,3})\[(?=[^]\n]*]:)", re.MULTILINE)  # of links that are elsewhere in the text


def is_seen(character: str) -> bool:
    """True if a character is a letter, mark, digit, sign or space, and no control, format or private character."""
    return character.isprintable() or unicodedata.category(character) == "Zs"


class _Codes(dict[int, str]):
    """Replacement of each character; looked up once."""

    def __missing__(self, code: int) -> str:
        character = chr(code)
        if is_seen(character) or character in _KEPT:
            shown = character
        else:
            shown = f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"
        self[code] = shown
        return shown


_CODES = _Codes()


def visible(text: str) -> str:
    r"""Text whose characters are all seen: others but newline and tab become codes, such as `\x1b` or `\u202e`.

    So nothing in it moves a cursor, colors a terminal, turns the direction of what stands around it, or hides.
    """
    return text if text.isprintable() else text.translate(_CODES)


def plain_markdown(text: str) -> str:
    r"""Text in which Markdown finds no HTML, link or picture: `<b>` becomes `&lt;b>`, and `](` becomes `]\(`."""
    return _ADDRESS.sub(r"\1\\[", _LINK.sub(r"]\\", _HTML.sub("&lt;", text)))


def script_source(script: str) -> str:
    """Source in a page's Content-Security-Policy for its own script: a browser then runs no other one on the page."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"
