"""`python -m motorline TABLE`: the command line of a computer that has Python and the maker's library only.

Its options are those of `swim2real deploy`, made from the same dataclass and docstrings.
"""

from __future__ import annotations

import argparse
import inspect
import os
import re
import sys
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import get_args, get_type_hints

from motorline.deploying import DeployOptions, deploy
from swimbase.errors import Swim2RealError
from swimbase.escaping import visible


def main(words: Sequence[str] | None = None) -> int:
    """Sends a table and returns the exit code: 0 done, 1 the work failed (with a sentence), 2 wrong arguments."""
    options = vars(_parser().parse_args(words))
    try:
        deploy(options.pop("commands"), DeployOptions(**options))
        sys.stdout.flush()
    except BrokenPipeError:  # the reader of our output has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (Swim2RealError, KeyboardInterrupt) as error:
        sys.stderr.write(f"motorline: {visible(str(error) or 'interrupted')}\n")
        return getattr(error, "exit_code", 1)
    return 0


def _parser() -> argparse.ArgumentParser:
    described, hints = {**_entries(deploy), **_entries(DeployOptions)}, get_type_hints(DeployOptions)
    about = inspect.cleandoc(deploy.__doc__ or "").partition("\n\nArgs:")[0]
    parser = argparse.ArgumentParser("python -m motorline", description=about, allow_abbrev=False)
    parser.add_argument("commands", type=Path, help=described.get("commands"))
    for field in fields(DeployOptions):
        kind = next(iter(get_args(hints[field.name])), hints[field.name])  # Path of Path | None
        option, text = f"--{field.name.replace('_', '-')}", described.get(field.name)
        if kind is bool:
            parser.add_argument(option, action="store_true", help=text)
        else:
            parser.add_argument(option, type=kind, default=field.default, help=text)
    return parser


def _entries(documented: object) -> dict[str, str]:
    """The names in a docstring's list of arguments or attributes, and what it says of each in a line."""
    return dict(re.findall(r"^    (\w+): (.+)$", inspect.getdoc(documented) or "", re.MULTILINE))


if __name__ == "__main__":
    sys.exit(main())
