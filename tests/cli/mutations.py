"""Damaged files: changes of what a file says, and of its bytes. The same seed gives the same changes."""

from __future__ import annotations

import copy
import io
import json
import random
from typing import Any

import numpy as np

LONG = "x" * 20_000
ODD = [
    None, True, False, 0, -1, 1, 3, 1e-300, 1e300, -1e300, 10**15, 10**30, 0.5, float("nan"), float("inf"),
    -float("inf"),
    "", " ", "0", "nan", "text", LONG, "\x00", "\ud800", "\u202e\u200b", "e\u0301\U0001f41f",
    "../../etc/passwd", "/dev/zero",
    "a\nb", [], {}, [[]], [[[[[1]]]]], {"": {}}, [1, "a", None], [None], [1e300, 2.0],
    {"a": [1, {"b": None}]}, "python:x:y",
]  # fmt: skip
WORDS = [
    "", " ", "nan", "inf", "-1", "1e400", "1e300", "-1e300", "1e-300", "0x10", "'", '"', "[]", "{}", "true", "[1, 2]",
    "99999999999999999999999", "a" * 500, "\u202e", "\x00", "é", '"""', "1979-05-27", "[[1], 2]",
    "[nan, inf]", "1_000", ",,,",
]  # fmt: skip


def places(content: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of all that stands in nested lists and dictionaries."""
    found = [path] if path else []
    pairs = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in pairs:
        found += places(value, (*path, key))
    return found


def changed(content: Any, chance: random.Random) -> Any:
    """A copy in which one thing is another, is gone, is twice there, or has another name."""
    made = copy.deepcopy(content)
    found = places(made)
    if not found or chance.random() < 0.02:
        return chance.choice(ODD)
    # what stands high is met as often as the many numbers below it
    depth = chance.choice(sorted({len(path) for path in found}))
    path = chance.choice([path for path in found if len(path) == depth])
    above = made
    for key in path[:-1]:
        above = above[key]
    key, kind = path[-1], chance.randrange(8)
    if kind == 0:
        del above[key]
    elif kind == 1 and isinstance(above, dict):
        above[chance.choice(["", "x", LONG, "\u202e", key + " ", "__proto__"])] = above.pop(key)
    elif kind == 2:
        above[key] = [above[key]]
    elif kind == 3:
        above[key] = {"value": above[key]}
    elif kind == 4 and isinstance(above[key], (list, dict)) and above[key]:
        below = above[key]
        if isinstance(below, list):
            below.extend(below[: chance.randrange(1, 3)])
        else:
            below["more"] = chance.choice(list(below.values()))
    elif kind == 5 and isinstance(above[key], (int, float)) and not isinstance(above[key], bool):
        above[key] = above[key] * chance.choice([-1, 0, 1e-9, 1e9, 1e300]) if above[key] < 1e200 else 0
    else:
        above[key] = chance.choice(ODD)
    return made


def json_bytes(content: Any, chance: random.Random) -> bytes:
    """As JSON, now and then with a key twice, a number beyond all, or nested for ever."""
    text = json.dumps(content)
    kind = chance.randrange(30)
    if kind == 0 and "{" in text:
        text = text.replace("{", '{"format": 2, "format": null, ', 1)
    elif kind == 1:
        text = text.replace("0.", "1e999", 1)
    elif kind == 2:
        text = "[" * 100_000
    elif kind == 3:
        text = text.replace(": 1", ": " + "9" * 5000, 1)
    return text.encode("utf-8", "surrogatepass")


def bytes_changed(data: bytes, chance: random.Random) -> bytes:
    """The same bytes with some flipped, cut, put in, in another encoding, or with a mark before them."""
    place, length = chance.randrange(len(data) + 1), chance.randrange(1, 50)
    match chance.randrange(11):
        case 0:
            return data[:place]
        case 1:
            return data[:place] + data[place + length :]
        case 2:
            return data[:place] + data[place : place + length] + data[place:]
        case 3:
            return data[:place] + chance.randbytes(chance.randrange(1, 9)) + data[place:]
        case 4:
            return b"\xef\xbb\xbf" + data
        case 5:
            return data.decode("utf-8", "replace").encode(chance.choice(["utf-16", "utf-32", "utf-7"]))
        case 6:
            return data[:place] + b"\x00" * length + data[place:]
        case 7:
            return data.replace(b"\n", chance.choice([b"\r\n", b"\r", b"\n\n", b""]))
        case 8:
            return chance.choice([b"", b"\n", b"\x00", b"{}", b"[]", b"null", b"0", b'""', b"PK\x03\x04", b"\xff\xfe"])
        case 9:
            return data + data[: chance.randrange(len(data) + 1)]
        case _:
            made = bytearray(data)
            for _ in range(chance.randrange(1, 9)):
                if made:
                    made[chance.randrange(len(made))] ^= 1 << chance.randrange(8)
            return bytes(made)


def lines_changed(data: bytes, chance: random.Random, signs: str) -> bytes:
    """A table or a TOML file in which a cell or a value is another, or a line is gone or twice there."""
    lines = data.decode().split("\n")
    at = chance.randrange(len(lines))
    kind = chance.randrange(6)
    if kind == 0:
        del lines[at]
    elif kind == 1:
        lines.insert(at, lines[chance.randrange(len(lines))])
    elif signs == ",":
        cells = lines[at].split(",")
        cells[chance.randrange(len(cells))] = chance.choice(WORDS)
        lines[at] = ",".join(cells)
        if kind == 2:
            lines[at] += chance.choice([",", ",1", ",,,,"])
    else:
        values = [i for i, line in enumerate(lines) if "=" in line]
        at = chance.choice(values)
        key = lines[at].partition("=")[0]
        odd = [*WORDS, '""', '"text"', "-1", "1e300", "0", "{}", '["a"]', "[[0, 1e300]]", '"/dev/zero"', '"../x.xml"']
        lines[at] = f"{key}= {chance.choice(odd)}" if kind > 2 else f"more{key}= 1"
    return "\n".join(lines).encode()


def arrays_changed(data: bytes, chance: random.Random) -> bytes:
    """An npz file in which an array is gone, or of another type, shape or content."""
    with np.load(io.BytesIO(data)) as stored:
        arrays = dict(stored)
    name = chance.choice(sorted(arrays))
    array = arrays[name]
    odd = [
        np.zeros(0), np.zeros(()), np.array("text"), np.array([["a"]]), np.array(True), np.array(1j),
        np.full(array.shape, np.nan),
        np.zeros((1, 2, 3, 4)), np.array(1e300), array[..., None], np.zeros(array.shape, "M8[s]"),
        np.ones(array.shape, "S3"),
        array[:0] if array.ndim else array, np.full(array.shape, 1e300), np.full(array.shape, -1),
    ]  # fmt: skip
    kind = chance.randrange(4)
    if kind == 0:
        del arrays[name]
    elif kind == 1:
        arrays[chance.choice(["x", "9/name", "0/sensors/x/name"])] = arrays.pop(name)
    else:
        arrays[name] = chance.choice(odd)
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def mutated(name: str, data: bytes, chance: random.Random) -> bytes:
    """A damaged file; what it says is changed three times of four, else its bytes."""
    if chance.random() < 0.25:
        return bytes_changed(data, chance)
    ending = name.rpartition(".")[2]
    match ending:
        case "json":
            return json_bytes(changed(json.loads(data), chance), chance)
        case "jsonl":
            lines = data.split(b"\n")[:-1]
            at = chance.randrange(len(lines))
            lines[at] = json_bytes(changed(json.loads(lines[at]), chance), chance)
            return b"\n".join(lines) + b"\n"
        case "npz":
            return arrays_changed(data, chance)
        case _:
            return lines_changed(data, chance, "," if ending == "csv" else "=")
