"""Writes the parts of pages that the code decides: `python docs/hooks.py`, after a change of them.

They stand between two comments, so that a page is complete as a file: the table of figures, and files shown as
examples. The references of commands and Python are too long for that: each build of the site adds them, and the pages
whose text stands elsewhere, such as the home page, the contributor's guide, the changelog and the examples.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from mkdocs.structure.files import File

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

ROOT = Path(__file__).parent.parent

# pages whose text stands elsewhere in the repository
SOURCES = {
    "index.md": "README.md",
    "contributing.md": "CONTRIBUTING.md",
    "changelog.md": "CHANGELOG.md",
    "examples/finger.md": "examples/finger/README.md",
    "examples/snake.md": "examples/snake/README.md",
    "examples/arm.md": "examples/arm/README.md",
}
COMMANDS = "reference/commands.md"  # what it has by hand comes first, then a section for each command
ROOMS = "reference/rooms.md"  # likewise, then the public names of each room that exports any
WRITTEN = re.compile(r"(<!-- written by docs/hooks\.py: (\S+) -->\n).*?(<!-- end -->)", re.DOTALL)
LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s#]+)(#[^)\s]*)?\)")

HELP = """
import contextlib, io, json, sys
from swim2real.cli.main import COMMANDS, EVERYWHERE, main

def help_of(name):
    text = io.StringIO()
    with contextlib.redirect_stdout(text), contextlib.suppress(SystemExit):
        main([name, "--help-all"])
    return text.getvalue().replace(EVERYWHERE, "")  # said once, at the top of the page

json.dump({title: {name: help_of(name) for name in group} for title, group in COMMANDS.items()}, sys.stdout)
"""

TABLE = """
from swim2real.objective.figures import FIGURES

print("| key | unit shown | meaning |", "|---|---|---|", sep="\\n")
for name, figure in FIGURES.items():
    print(f"| `{name}` | {figure.unit} | {figure.meaning} |")
"""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the pages whose text stands elsewhere."""
    pages = {page: (ROOT / source).read_text("utf-8") for page, source in SOURCES.items()}
    for page, text in pages.items():
        files.append(File.generated(config, page, content=text))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Points links between files of the repository to their pages, and adds the commands' help to their page.

    A link to a file that is not on the site is shown as its text.
    """
    place = page.file.src_uri
    source = Path(SOURCES.get(place, f"docs/{place}"))

    def rewritten(link: re.Match[str]) -> str:
        image, text, target, anchor = link.groups()
        path = Path(os.path.normpath(source.parent / target))
        if target.startswith("http") or not (ROOT / path).exists():
            return link.group(0)
        on_site = next((p for p, s in SOURCES.items() if path in (Path(s), Path(s).parent) and path != Path()), None)
        if on_site is None and path.parts[0] == "docs":
            on_site = str(path.relative_to("docs"))
        return f"{image}[{text}]({os.path.relpath(on_site, Path(place).parent)}{anchor or ''})" if on_site else text

    generated = {COMMANDS: _commands, ROOMS: _rooms}.get(place, str)
    return LINK.sub(rewritten, markdown) + generated()


def current(page: str) -> str:
    """A page's text with the parts between its comments as the code now has them."""
    return WRITTEN.sub(lambda found: f"{found[1]}\n{_part(found[2])}\n{found[3]}", page)


def _part(name: str) -> str:
    """The table of figures, or the file of that name as an example in Python."""
    return _output(TABLE) if name == "figures" else f"```python\n{(ROOT / name).read_text('utf-8')}```\n"


def _rooms() -> str:
    """A reference for each package that exports names."""
    exporting = [
        path for path in (ROOT / "src/swim2real").glob("*/__init__.py") if "__all__" in path.read_text("utf-8")
    ]
    return "".join(f"\n\n::: swim2real.{path.parent.name}" for path in sorted(exporting))


def _output(script: str) -> str:
    """What a script of the package prints."""
    environment = {**os.environ, "COLUMNS": "92", "NO_COLOR": "1", "PYTHONPATH": str(ROOT / "src")}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    return done.stdout


def _commands() -> str:
    """A section for each command: its description, and what else its `--help` prints."""
    parts: list[str] = ["\n"]
    for title, group in json.loads(_output(HELP)).items():
        parts.append(f"## {title}\n")
        for name, text in group.items():
            marked = re.sub(r"^ (\S.*?) *\n -+ *$", "\f\\1:", text, flags=re.MULTILINE)  # titles, not underlined
            usage, _, rest = marked.partition("\n\n")
            description, _, options = rest.partition("\f")
            options = "\n".join(line.rstrip() for line in options.replace("\f", "").splitlines()).strip()
            escaped = re.sub(r"([*_<>\[\]])", r"\\\1", description.strip())  # nothing in it is markup
            parts.append(f"### {name}\n\n{escaped}\n\n```text\n{usage}\n\n{options}\n```\n")
    return "\n".join(parts)


if __name__ == "__main__":
    for path in (ROOT / "docs").rglob("*.md"):
        path.write_text(current(path.read_text("utf-8")), "utf-8", newline="\n")
