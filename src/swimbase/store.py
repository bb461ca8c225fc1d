"""Files on the disk: written whole or not at all, appended line by line, locked while a process works on them.

A reader never sees half of a file, and a process that is killed at any moment leaves the old content or the new one.
Every function raises the `OSError` of the system with the file's name; those who know what the file is for turn it into
a sentence with `writing`. Files may come from anywhere: one that is too large, or no
file but a device or a pipe, is refused before it is read.

A motor's computer writes files as well, without NumPy and filelock: these are imported by the functions that need them.
"""

from __future__ import annotations

import errno
import json
import math
import os
import shutil
import stat
from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import ZipFile

from swimbase.errors import Swim2RealError
from swimbase.parsing import from_json

if TYPE_CHECKING:
    from numpy.typing import NDArray

MOST_ARRAYS = 1 << 29  # bytes of arrays in a file that isn't expected to have more
PART = ".part"  # suffix of a file that is still being written
_BEFORE = PART + "-before"  # of a folder that is being replaced
LOCK = ".lock"
MOST_JSON = 32_000_000  # bytes of a JSON file
MOST_TEXT = 4_000_000  # bytes of a text that a person writes, as of a robot file
MOST_TABLE = 64_000_000  # bytes of a CSV table
MOST_RECORD = 256_000_000  # bytes of a record of JSON lines: some 100,000 evaluations
MOST_ROWS = 1_000_000  # of a CSV table
_FULL = (errno.ENOSPC, errno.EDQUOT) if hasattr(errno, "EDQUOT") else (errno.ENOSPC,)


@contextmanager
def whole_file(path: str | Path) -> Generator[Path]:
    """Gives a path beside a file to write to; it takes the file's place at a clean end and is removed after an error.

    Args:
        path: Path of the file that is written or replaced.
    """
    place = Path(path)
    part = place.with_name(place.name + PART)
    try:
        with _named(place):
            part.unlink(missing_ok=True)  # a link that came with a folder would be followed
            yield part
            part.replace(place)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


@contextmanager
def whole_folder(path: str | Path) -> Generator[Path]:
    """Gives an empty folder beside a path; it takes the path's place at a clean end and is removed after an error.

    What it replaces is beside it, under another name, until the new one is there. Where a process was killed in
    between, the next call begins by putting it back.

    Args:
        path: Path of the folder that is written or replaced.
    """
    place = Path(path)
    part, before = (place.with_name(place.name + suffix) for suffix in (PART, _BEFORE))
    shutil.rmtree(part, ignore_errors=True)
    try:
        with _named(place):
            _put_back(before, place)
            part.mkdir(parents=True)
            yield part
            if place.is_dir() and not place.is_symlink():
                place.replace(before)
            part.replace(place)
    finally:
        _put_back(before, place)
        shutil.rmtree(part, ignore_errors=True)


def _put_back(before: Path, place: Path) -> None:
    """Gives a folder that was to be replaced its name back, or removes it where another has taken its place."""
    if before.is_dir() and not os.path.lexists(place):
        before.replace(place)
    shutil.rmtree(before, ignore_errors=True)


@contextmanager
def _named(place: Path) -> Generator[None]:
    """Names the file in an error of the system, which knows it only where the file is opened, and then as a part."""
    try:
        yield
    except OSError as error:
        if error.filename is None or str(error.filename).endswith(PART):
            error.filename, error.filename2 = str(place), None
        raise


def remove_leftovers(folder: str | Path, names: Iterable[str]) -> None:
    """Removes what processes that were killed have left of what they were writing; puts back what they hadn't replaced.

    To be called by the process that has the folder locked, for what is only written by one that has.

    Args:
        folder: The folder.
        names: Names of the files and folders, or patterns of them, such as `advisor/*.json`.

    Raises:
        OSError: A folder on the way to one of them is a link, through which other folders would be written.
    """
    for name in names:
        for way in Path(name).parents[:-1]:
            for place in Path(folder).glob(way.as_posix()):
                _refuse_link(place)
        for part in Path(folder).glob(name + PART):
            if part.is_dir():
                shutil.rmtree(part, ignore_errors=True)
            else:
                with suppress(OSError):
                    part.unlink()
        for before in Path(folder).glob(name + _BEFORE):
            _put_back(before, before.with_name(before.name.removesuffix(_BEFORE)))


def _refuse_link(place: Path) -> None:
    if place.is_symlink():
        raise OSError(errno.ELOOP, f"'{place}' is a link, which isn't written through; put what it leads to there")


def reason(error: OSError, file: str | Path | None = None) -> str:
    """Why a file can't be written, in words; of a full disk also how much room it has, and what to do.

    Args:
        error: What the system said.
        file: The file or folder, where the error doesn't name it.
    """
    text, named = error.strerror or str(error), error.filename or file
    if named is None:
        return text
    place = Path(os.fsdecode(named)).absolute()
    in_the_way = next((one for one in (place, *place.parents) if one.is_file()), None)
    if error.errno in (errno.ENOTDIR, errno.EEXIST) and in_the_way is not None:
        return f"'{in_the_way}' is a file and no folder; give another place"
    if error.errno not in _FULL:
        return text
    there = next(folder for folder in (place, *place.parents) if folder.is_dir())
    try:
        free = shutil.disk_usage(there).free
    except OSError:
        return text
    size = f"{free / 1e9:.1f} GB" if free >= 1e9 else f"{free / 1e6:.1f} MB" if free >= 1e6 else f"{free / 1e3:.0f} kB"
    return f"{text} ({size} free in '{there}'; make room)"


@contextmanager
def writing(
    path: str | Path, error: type[Swim2RealError], remedy: str = "", *, what: str = "", busy: str = ""
) -> Generator[None]:
    """Turns what the system says of a disk into a sentence: can't write 'FILE': REASON; REMEDY.

    Args:
        path: The file or folder that is written.
        error: Type of the error that is raised.
        remedy: What to do, without a full stop.
        what: What stands at the path, such as "run folder"; without it, the sentence names the very file that failed.
        busy: Sentence for a folder that another process has `locked`.

    Raises:
        Swim2RealError: Something can't be written; the error has the type `error`.
    """
    try:
        yield
    except OSError as failure:
        if busy and isinstance(failure, BlockingIOError):
            raise error(busy) from None
        named = f"{what} '{path}'" if what else f"'{failure.filename or path}'"
        raise error(f"can't write {named}: {reason(failure, path)}{remedy and f'; {remedy}'}") from failure


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
    """Writes an .npz file, whole or not at all; measured numbers hardly get smaller by compression."""
    import numpy as np

    with whole_file(path) as part, part.open("wb") as file:
        np.savez(file, **arrays)


def read_bytes(path: str | Path, most: int) -> bytes:
    """The content of a file.

    Args:
        path: Path of the file.
        most: Bytes that it may have.

    Raises:
        FileNotFoundError: It isn't there.
        OSError: It can't be read, or is a device or a pipe.
        ValueError: It is too large; the message says how large.
    """
    _refuse_device(path)
    with Path(path).open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        if size > most:
            raise ValueError(f"it has {size / 1e6:.1f} MB; at most {most / 1e6:g} MB are read")
        content = file.read(most + 1)
    if len(content) > most:  # it grew, or its size isn't known
        raise ValueError(f"it has more than {most / 1e6:g} MB; at most that is read")
    return content


def _refuse_device(path: str | Path) -> None:
    if not stat.S_ISREG(os.stat(path).st_mode) and not os.path.isdir(path):
        raise OSError(errno.EINVAL, "it is a device, a pipe or a socket, not a file", str(path))


def read_text(path: str | Path, most: int = MOST_TEXT, encoding: str = "utf-8") -> str:
    """The content of a text file, with line ends as they are.

    Args:
        path: Path of the file.
        most: Bytes that it may have.
        encoding: `utf-8-sig` for a file that may begin with a byte order mark.

    Raises:
        OSError: As `read_bytes` has it.
        ValueError: It is too large, or isn't text in UTF-8.
    """
    return read_bytes(path, most).decode(encoding)


def read_json(path: str | Path, most: int = MOST_JSON) -> Any:
    """The content of a JSON file.

    Args:
        path: Path of the file.
        most: Bytes that it may have.

    Raises:
        FileNotFoundError: It isn't there.
        OSError: It can't be read.
        ValueError: It is too large, or isn't as `from_json` wants it.
    """
    return from_json(read_bytes(path, most))


def read_arrays(path: str | Path, most: int = MOST_ARRAYS) -> dict[str, NDArray[Any]]:
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

    _refuse_device(path)
    with Path(path).open("rb") as file:
        try:
            with ZipFile(file) as archive:
                members = archive.infolist()
                size = sum(member.file_size for member in members)
                if size > most:
                    raise ValueError(f"its arrays have {size / 1e6:.0f} MB; at most {most / 1e6:.0f} MB are read")
                for member in members:
                    if not member.filename.endswith(".npy"):
                        raise ValueError(f"'{member.filename[:60]}' in it is no array")
                    with archive.open(member) as packed:
                        _check_header(packed, member.file_size)
            file.seek(0)
            with np.load(file, allow_pickle=False) as stored:
                return dict(stored)
        except (OSError, ValueError):
            raise
        except Exception as error:  # a damaged file makes zipfile, zlib and NumPy raise errors of a dozen types
            raise ValueError(str(error) or type(error).__name__) from error


def _check_header(packed: Any, size: int) -> None:
    """Refuses a pickle, and a header that promises more than there is, before memory is taken for it."""
    from numpy.lib import format as npy

    version = npy.read_magic(packed)
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, kind = read(packed)
    if kind.hasobject:
        raise ValueError("it holds a pickle, which could run code; it isn't read")
    if packed.tell() + math.prod(shape) * kind.itemsize != size:
        raise ValueError(f"an array of shape {shape} doesn't fit the {size} bytes that are there")


def append_lines(path: str | Path, entries: Sequence[Mapping[str, Any]]) -> None:
    """Adds entries to a record of JSON lines, none where there are none; they are on the disk when this returns."""
    if not entries:
        return
    lines = "".join(json.dumps(entry, allow_nan=False) + "\n" for entry in entries)
    with _named(Path(path)), Path(path).open("ab") as file:
        file.write(lines.encode())
        file.flush()
        os.fsync(file.fileno())


def read_lines(path: str | Path) -> list[bytes]:
    """The whole lines of a record, none where there is no file. What a crash left of a last line doesn't count.

    Raises:
        OSError: It can't be read.
        ValueError: It is too large; the message says how large.
    """
    return read_bytes(path, MOST_RECORD).split(b"\n")[:-1] if Path(path).is_file() else []


def drop_cut_line(path: str | Path) -> None:
    """Removes what a crash left of the last line of a record, so that appending is safe.

    Raises:
        OSError: It can't be changed, or is a link.
    """
    place = Path(path)
    _refuse_link(place)
    if not place.is_file() or place.stat().st_size > MOST_RECORD:  # which isn't read either
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


def source_from(folder: Path, source: str) -> str:
    """Origin of something, as a file in a folder says it: the place of what is there, other words as they are.

    `source_at` reads it, and what earlier versions wrote: an absolute path, or one from where they were started.
    """
    return path_from(folder, Path(source)) if source and Path(source).exists() else source


def source_at(folder: Path, source: str) -> str:
    """Origin of something, seen from here."""
    there = folder / source
    return os.path.normpath(there) if source and there.exists() else source


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
