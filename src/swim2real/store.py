"""Files on the disk: written whole or not at all, appended line by line, locked while a process works on them.

A reader never sees half of a file, and a process that is killed at any moment leaves the old content or the new one.
Every function raises the `OSError` of the system; those who know what the file is for turn it into a sentence.

A motor's computer writes files as well, without NumPy and filelock: these are imported by the functions that need them.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from zipfile import ZipFile

MOST_ARRAYS = 1 << 29  # bytes of arrays in a file that isn't expected to have more
PART = ".part"  # suffix of a file that is still being written
LOCK = ".lock"


@contextmanager
def whole_file(path: str | Path) -> Generator[Path]:
    """Gives a path beside a file to write to; it takes the file's place at a clean end and is removed after an error.

    Args:
        path: Path of the file that is written or replaced.
    """
    place = Path(path)
    part = place.with_name(place.name + PART)
    try:
        yield part
        part.replace(place)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


@contextmanager
def whole_folder(path: str | Path) -> Generator[Path]:
    """Gives an empty folder beside a path; it takes the path's place at a clean end and is removed after an error.

    Args:
        path: Path of the folder that is written or replaced.
    """
    place = Path(path)
    part = place.with_name(place.name + PART)
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    try:
        yield part
        shutil.rmtree(place, ignore_errors=True)
        part.replace(place)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise


def write_text(path: str | Path, text: str) -> None:
    """Writes a text file in UTF-8, whole or not at all."""
    with whole_file(path) as part:
        part.write_text(text, encoding="utf-8")


def write_bytes(path: str | Path, content: bytes) -> None:
    """Writes a binary file, whole or not at all."""
    with whole_file(path) as part:
        part.write_bytes(content)


def write_json(path: str | Path, content: Any, *, indent: int | None = 2) -> None:
    """Writes a JSON file, whole or not at all.

    Args:
        path: Where to.
        content: Plain lists, dictionaries, texts and numbers; finite ones, for NaN is no JSON.
        indent: Spaces a level; None writes one line.
    """
    write_text(path, json.dumps(content, indent=indent, allow_nan=False, ensure_ascii=False) + "\n")


def write_arrays(path: str | Path, arrays: Mapping[str, Any]) -> None:
    """Writes a compressed .npz file, whole or not at all."""
    import numpy as np

    with whole_file(path) as part, part.open("wb") as file:
        np.savez_compressed(file, **arrays)


def read_json(path: str | Path) -> Any:
    """The content of a JSON file.

    Raises:
        FileNotFoundError: It isn't there.
        OSError: It can't be read.
        ValueError: It isn't JSON in UTF-8; the message says where.
    """
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def read_arrays(path: str | Path, most: int = MOST_ARRAYS) -> dict[str, Any]:
    """The arrays of an .npz file, by name. Pickles in it are refused, not loaded.

    Args:
        path: Path of the file.
        most: Bytes that the arrays may have in all; more are refused before they are unpacked.

    Raises:
        FileNotFoundError: It isn't there.
        OSError: It can't be read.
        ValueError: It is damaged, too large, or holds something else than arrays.
    """
    import numpy as np

    with Path(path).open("rb") as file:
        try:
            with ZipFile(file) as members:
                size = sum(member.file_size for member in members.infolist())
            if size > most:
                raise ValueError(f"its arrays have {size / 1e6:.0f} MB; at most {most / 1e6:.0f} MB are read")
            file.seek(0)
            with np.load(file, allow_pickle=False) as stored:
                arrays = dict(stored)
        except OSError:
            raise
        except Exception as error:  # a damaged file makes zipfile, zlib and NumPy raise errors of a dozen types
            if "allow_pickle" in str(error):
                raise ValueError("it holds a pickle, which could run code; it isn't read") from error
            raise ValueError(str(error) or type(error).__name__) from error
    if other := next((name for name, array in arrays.items() if not isinstance(array, np.ndarray)), None):
        raise ValueError(f"'{other}' in it is no array")
    return arrays


def append_line(path: str | Path, entry: Mapping[str, Any]) -> None:
    """Adds an entry to a record of JSON lines; it is on the disk when this returns."""
    append_lines(path, [entry])


def append_lines(path: str | Path, entries: Sequence[Mapping[str, Any]]) -> None:
    """Adds entries to a record of JSON lines, none where there are none; they are on the disk when this returns."""
    if not entries:
        return
    lines = "".join(json.dumps(entry, allow_nan=False) + "\n" for entry in entries)
    with Path(path).open("ab") as file:
        file.write(lines.encode())
        file.flush()
        os.fsync(file.fileno())


def read_lines(path: str | Path) -> list[bytes]:
    """The whole lines of a record, none where there is no file. What a crash left of a last line doesn't count."""
    place = Path(path)
    return place.read_bytes().split(b"\n")[:-1] if place.is_file() else []


def drop_cut_line(path: str | Path) -> None:
    """Removes what a crash left of the last line of a record, so that appending is safe."""
    place = Path(path)
    if not place.is_file():
        return
    with place.open("r+b") as file:
        content = file.read()
        end = content.rfind(b"\n") + 1
        if end < len(content):
            file.truncate(end)


def path_from(folder: Path, file: Path) -> str:
    """The relative path from a folder to a file, so that both can be moved together; absolute on another drive."""
    try:
        return Path(os.path.relpath(file.resolve(), folder.resolve())).as_posix()
    except ValueError:  # on another drive
        return file.resolve().as_posix()


@contextmanager
def locked(folder: str | Path, timeout: float = 0.0) -> Generator[None]:
    """Makes a folder where there is none and keeps other processes out of it.

    Args:
        folder: The folder.
        timeout: Time to wait for another process to leave it [s].

    Raises:
        BlockingIOError: Another process has it.
        OSError: The folder can't be made or locked.
    """
    from filelock import FileLock, Timeout

    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    lock = FileLock(place / LOCK, timeout=timeout)
    try:
        lock.acquire()
    except Timeout:
        raise BlockingIOError(f"another process is working on '{place}'") from None
    try:
        yield
    finally:
        lock.release()
