"""Python functions and classes that a file names as `python:FILE.py:NAME` or `python:MODULE:NAME`.

All that would run is found, read and hashed before any of it does.
"""

from __future__ import annotations

import hashlib
import importlib
import os
import re
import sys
import sysconfig
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.machinery import EXTENSION_SUFFIXES, ModuleSpec, PathFinder, SourceFileLoader
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

from swim2real.consent import CODE, Request
from swimbase.errors import ConsentError

PREFIX = "python:"
FORMS = "python:MODULE:FUNCTION or python:FILE.py:FUNCTION"
_OWN = "swim2real.robots.fish."  # modules of ours that robot files name
_COMPILED = (".pyc", *EXTENSION_SUFFIXES)
_CACHE = "__pycache__"
_MOST_NAMED = 6  # files in a sentence
_SHOWN_HASH = 12  # digits


@dataclass(frozen=True)
class NamedCode:
    """A function or class that a file names.

    Attributes:
        module: Python file, from the folder, or module.
        name: Name of the function or class in it.
        folder: Folder from which a Python file is looked up.
    """

    module: str
    name: str
    folder: Path

    @classmethod
    def parse(cls, text: str, folder: Path) -> NamedCode | None:
        """Reads a text that names code; None for one of another form."""
        parts = text.split(":")
        return cls(parts[1], parts[2], folder) if len(parts) == 3 and text.startswith(PREFIX) else None

    @property
    def file(self) -> str | None:
        """The Python file, as it is named; None for a module."""
        return self.module if self.module.endswith(".py") else None

    @property
    def runs(self) -> bool:
        """True if anything would run that isn't ours: not if there is no such file or module."""
        if self.file is not None:
            return os.path.isfile(self.folder / self.file)
        top = self.module.partition(".")[0]
        return not self.module.startswith(_OWN) and (top in sys.modules or _found(top) is not None)

    def files(self) -> tuple[Path, ...]:
        """All that would run, as far as is known without running it; the file itself comes first.

        That are, beside and below a Python file, those whose names it or they mention, compiled ones as well; of a
        module in a package, the whole package; nothing of a module that is part of Python's own program.
        """
        if self.file is not None:
            return _mentioned(self.folder / self.file)
        spec = _found(self.module.partition(".")[0])
        if spec is None:
            return ()
        installed = _is_installed(spec)
        if spec.submodule_search_locations is not None:
            return tuple(file for place in spec.submodule_search_locations for file in _all_code(place, installed))
        if spec.origin is None or not os.path.isfile(spec.origin):
            return ()
        return (Path(spec.origin),) if installed else _mentioned(Path(spec.origin))

    def load(self) -> Any:
        """The function or class. Raises whatever its code does.

        A Python file is read itself, not its compiled copy in `__pycache__`, which may hold other code.
        """
        if self.file is not None and self.runs:
            _Guard.watch(Path(os.path.realpath(self.folder / self.file)).parent, self.files())
        with _no_compiled_copies():
            loaded = importlib.import_module(self.module) if self.file is None else _module(self.folder / self.file)
        return getattr(loaded, self.name)

    def place(self) -> str:
        """Place of the code, for a sentence: path, size and hash, and what lies beside it."""
        files = self.files()
        if not files:
            return f"module '{self.module}'"
        first, *others = files
        if self.file is None and first.name == "__init__.py":
            return f"module '{self.module}' in '{first.parent}' ({len(files)} files)"
        names = [f"'{os.path.relpath(file, first.parent)}'" for file in others[:_MOST_NAMED]]
        names += [f"{len(others) - _MOST_NAMED} more"] if len(others) > _MOST_NAMED else []
        beside = f", with {', '.join(names)} beside it" if names else ""
        content = first.read_bytes()
        mark = hashlib.sha256(content).hexdigest()[:_SHOWN_HASH]
        return f"'{first}' ({len(content):,} bytes, SHA-256 {mark}…{beside})"

    def digest(self) -> bytes:
        """A hash of the name and of all files, wherever they are."""
        files = self.files()
        mark = hashlib.sha256(f"{Path(self.module).name}:{self.name}".encode())
        for file in files:
            place = Path(os.path.relpath(file, files[0].parent)).as_posix()
            mark.update(f"\0{place}\0".encode() + hashlib.sha256(file.read_bytes()).digest())
        return mark.digest()


def request(where: str, said: bytes, codes: Sequence[NamedCode]) -> Request | None:
    """Request to run a file's code; None if nothing runs that isn't ours.

    Args:
        where: The file, for the sentence.
        said: What the file says otherwise, which counts for the hash.
        codes: What it names.
    """
    strange = [code for code in codes if code.runs]
    if not strange:
        return None
    mark, names = hashlib.sha256(b"code\0" + said), dict[str, list[str]]()
    for code in strange:
        mark.update(code.digest())
        names.setdefault(code.place(), []).append(f"'{code.name}'")
    told = "; ".join(f"{', '.join(of)} of {place}" for place, of in names.items())
    return Request(CODE, mark.hexdigest(), f"{where} names Python code, which would run with your rights: {told}")


class _Guard:
    """Refuses to import what lies beside or below allowed code without being part of it, once that is on the path."""

    _allowed: ClassVar[dict[Path, tuple[set[Path], list[Path]]]] = {}  # files, and places on the path before, by folder

    @classmethod
    def watch(cls, folder: Path, files: Sequence[Path]) -> None:
        """Allows these files of a folder, and what was on the path before there."""
        path = (Path(os.path.realpath(place)) for place in sys.path)
        before = [place for place in path if place.is_relative_to(folder)]
        cls._allowed.setdefault(folder, (set(), before))[0].update(Path(os.path.realpath(file)) for file in files)
        if cls not in sys.meta_path:
            sys.meta_path.insert(0, cls)

    @classmethod
    def find_spec(cls, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> None:
        """Finds nothing; raises ConsentError where another finder would find what wasn't allowed."""
        spec = PathFinder.find_spec(name, path)
        if spec is None or spec.origin is None:
            return
        file = Path(os.path.realpath(spec.origin))
        within = getattr(sys.modules.get(name.rpartition(".")[0]), "__file__", None)  # the package that it is part of
        for folder, (allowed, before) in cls._allowed.items():
            if within is not None and Path(os.path.realpath(within)) not in allowed:
                continue  # which another finder has brought
            if file.is_relative_to(folder) and file not in allowed and not any(map(file.is_relative_to, before)):
                raise ConsentError(
                    f"'{file}' would run as module '{name}', which the allowed code in '{folder}' doesn't mention; "
                    f"take it away, or mention it there"
                )


class _SourceLoader(SourceFileLoader):
    """Reads Python files and never their compiled copies."""

    def get_code(self, fullname: str) -> Any:
        return self.source_to_code(self.get_data(self.path), self.path)


def _module(path: Path) -> Any:
    if not os.path.isfile(path):
        raise FileNotFoundError(f"no Python file '{path}'")
    name = f"swim2real_robot_file.{path.stem}"
    spec = spec_from_file_location(name, path, loader=_SourceLoader(name, str(path)))
    if spec is None or spec.loader is None:
        raise ImportError(f"no Python file '{path}'")
    module = module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@contextmanager
def _no_compiled_copies() -> Generator[None]:
    """Writes no `__pycache__`, whose files count as code beside the code that was allowed."""
    before, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        yield
    finally:
        sys.dont_write_bytecode = before


def _found(module: str) -> ModuleSpec | None:
    """Finds a top-level module without importing it."""
    for finder in sys.meta_path:
        find = getattr(finder, "find_spec", None)
        try:
            spec = None if find is None else find(module, None)
        except (ValueError, OSError, ImportError):  # names that are none, which can't be imported either
            return None
        if spec is not None:
            return spec
    return None


def _is_installed(spec: ModuleSpec) -> bool:
    """True if a module is part of Python or was installed, rather than lying in a folder of somebody's."""
    places = spec.submodule_search_locations or ([] if spec.origin is None else [spec.origin])
    folders = [Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib", "purelib", "platlib")]
    return all(any(Path(place).resolve().is_relative_to(folder) for folder in folders) for place in places)


def _all_code(place: str, installed: bool) -> Iterator[Path]:
    """The code of a package; without the compiled copies of one that is installed."""
    for folder, folders, names in os.walk(place):
        if installed and _CACHE in folders:
            folders.remove(_CACHE)
        folders.sort()
        yield from (Path(folder, name) for name in sorted(names) if name.endswith((".py", *_COMPILED)))


def _mentioned(file: Path) -> tuple[Path, ...]:
    """A Python file, then the code beside and below it whose name it or one of these mentions, as an import must."""
    found, words = {file: None}, _words(file)
    while True:
        new = [other for other in _named(file.parent, words, set()) if other not in found]
        if not new:
            return tuple(found)
        found.update(dict.fromkeys(new))
        for other in new:
            words |= _words(other)


def _named(folder: Path, words: set[str], seen: set[str]) -> Iterator[Path]:
    """Code in a folder, and in folders below, whose names are among words."""
    place = os.path.realpath(folder)
    if place in seen:
        return
    seen.add(place)
    for name in sorted(os.listdir(folder)):
        path, stem = folder / name, name.partition(".")[0]
        if path.is_dir():
            if name in words or name == _CACHE:
                yield from _named(path, words, seen)
        elif (stem in words or stem == "__init__") and name.endswith((".py", *_COMPILED)) and path.is_file():
            yield path


def _words(file: Path) -> set[str]:
    return set(re.findall(r"\w+", file.read_text("utf-8", errors="replace"))) if file.suffix == ".py" else set()
