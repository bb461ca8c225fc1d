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
    None, True, 0, -1, 1e-300, 1e300, -1e300, 10**30, 0.5, float("nan"), float("inf"), "", "0", "nan", LONG, "\x00",
    "\ud800", "\u202e\u200b", "e\u0301\U0001f41f", "../../etc/passwd", "/dev/zero", "a\nb", [], {}, [[[[[1]]]]],
    {"": {}}, [1, "a", None], {"a": [1, {"b": None}]}, "python:x:y",
]  # fmt: skip
WORDS = [
    "", " ", "nan", "inf", "-1", "1e400", "1e300", "1e-300", "0x10", "'", '"', "[]", "{}", "true", "[1, 2]", "é", '"""',
    "99999999999999999999999", "a" * 500, "\u202e", "\x00", "1979-05-27", "[nan, inf]", "1_000", ",,,", '"../x.xml"',
    '"/dev/zero"', '["a"]', "[[0, 1e300]]",
]  # fmt: skip


def places(content: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of all that stands in nested lists and dictionaries."""
    found = [path] if path else []
    pairs = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in pairs:
        found += places(value, (*path, key))
    return found


def changed(content: Any, chance: random.Random) -> Any:
    """A copy in which one thing is another, is gone, or has another name."""
    made = copy.deepcopy(content)
    found = places(made)
    if not found or chance.random() < 0.02:
        return chance.choice(ODD)
    # what stands high is met as often as the many numbers below it
    depth = chance.choice(sorted({len(path) for path in found}))
    *path, key = chance.choice([path for path in found if len(path) == depth])
    above = made
    for step in path:
        above = above[step]
    number = isinstance(above[key], (int, float)) and not isinstance(above[key], bool)
    match chance.randrange(7):
        case 0:
            del above[key]
        case 1 if isinstance(above, dict):
            above[chance.choice(["", "x", LONG, "\u202e", key + " ", "__proto__"])] = above.pop(key)
        case 2:
            above[key] = chance.choice([[above[key]], {"value": above[key]}])
        case 3 if isinstance(above[key], list) and above[key]:
            above[key].extend(above[key][: chance.randrange(1, 3)])
        case 4 if number:
            above[key] = above[key] * chance.choice([-1, 0, 1e-9, 1e9, 1e300]) if above[key] < 1e200 else 0
        case _:
            above[key] = chance.choice(ODD)
    return made


def json_bytes(content: Any, chance: random.Random) -> bytes:
    """As JSON, now and then with a key twice, a number beyond all, or nested for ever."""
    text = json.dumps(content)
    match chance.randrange(30):
        case 0:
            text = text.replace("{", '{"format": 2, "format": null, ', 1)
        case 1:
            text = text.replace("0.", "1e999", 1)
        case 2:
            text = "[" * 100_000
        case 3:
            text = text.replace(": 1", ": " + "9" * 5000, 1)
    return text.encode("utf-8", "surrogatepass")


def bytes_changed(data: bytes, chance: random.Random) -> bytes:
    """The same bytes with some flipped, cut out, doubled, put in, in another encoding, or none of them."""
    place, length = chance.randrange(len(data) + 1), chance.randrange(1, 50)
    head, tail = data[:place], data[place:]
    flipped = bytearray(data)
    for _ in range(chance.randrange(1, 9)):
        flipped[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    return chance.choice([
        head, head + tail[length:], head + tail[:length] + tail, head + chance.randbytes(length) + tail, bytes(flipped),
        head + b"\x00" * length + tail, data.decode("utf-8", "replace").encode("utf-16"), b"\xef\xbb\xbf" + data,
        data.replace(b"\n", chance.choice([b"\r", b"\n\n", b""])), data + head,
        chance.choice([b"", b"\n", b"\x00", b"{}", b"[]", b"null", b"0", b'""', b"PK\x03\x04", b"\xff\xfe"]),
    ])  # fmt: skip


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
        lines[at] = ",".join(cells) + chance.choice(["", "", "", ",", ",1"])
    else:
        at = chance.choice([i for i, line in enumerate(lines) if "=" in line])
        key = lines[at].partition("=")[0]
        lines[at] = f"{key}= {chance.choice(WORDS)}" if kind > 2 else f"more{key}= 1"
    return "\n".join(lines).encode()


def arrays_changed(data: bytes, chance: random.Random) -> bytes:
    """An npz file in which an array is gone, has another name, or is of another type, shape or content."""
    with np.load(io.BytesIO(data)) as stored:
        arrays = dict(stored)
    name = chance.choice(sorted(arrays))
    array = arrays.pop(name)
    odd = [
        np.zeros(0), np.zeros(()), np.array("text"), np.array([["a"]]), np.array(True), np.array(1j), array[..., None],
        np.full(array.shape, np.nan), np.zeros((1, 2, 3, 4)), np.zeros(array.shape, "M8[s]"),
        np.ones(array.shape, "S3"), array[:0] if array.ndim else array, np.full(array.shape, 1e300),
    ]  # fmt: skip
    kind = chance.randrange(4)
    if kind == 1:
        arrays[chance.choice(["x", "9/name", "0/sensors/x/name"])] = array
    elif kind > 1:
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
