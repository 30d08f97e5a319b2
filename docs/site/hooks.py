"""Hooks of mkdocs: the reference is written from the code, and links out of docs/ become names.

`mkdocs build --strict` fails where a page links to what is not there.
"""

from __future__ import annotations

import inspect
import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

import hoap3
from hoap3.protocol.messages import Event, Setpoint, State, Target
from hoap3.tools.cli.app import command_line
from hoap3.tools.services.settings import REGISTRIES, SIDES, config_keys

HOUSE = Path(__file__).resolve().parents[2]
_SOURCE = re.compile(r'(src|srcset)="docs/')
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")
SETTINGS = """# Settings

Every key of every config, as `hoap3 config keys` prints them. N stands for a place in a list, from
0; `(kind)` for the mapping with that tag. [Configuration](../guides/configuration.md) describes
how a config is found and changed."""
COPIED = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "internals/contributing.md",
    "CHANGELOG.md": "reference/changelog.md",
}


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that are not written by hand."""
    pages = {
        "reference/commands.md": commands(),
        "reference/settings.md": settings(),
        "reference/messages.md": messages(),
        "reference/python.md": python(),
        **{page: (HOUSE / name).read_text(encoding="utf-8") for name, page in COPIED.items()},
    }
    for path, text in pages.items():
        files.append(File.generated(config, path, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Links to files outside docs/ become the names of these files."""
    here = page.file.src_path
    sources = {made: name for name, made in COPIED.items()}
    folder = posixpath.dirname(sources.get(here, f"docs/{here}"))

    def resolved(found: re.Match[str]) -> str:
        picture, text, path = found.groups()
        if path.startswith(("https://", "#")):
            return found[0]
        name, hash_, anchor = path.partition("#")
        target = posixpath.normpath(posixpath.join(folder, name))
        target = f"docs/{COPIED[target]}" if target in COPIED else target
        if target.startswith("docs/"):
            to = posixpath.relpath(target, posixpath.dirname(f"docs/{here}"))
            return f"{picture}[{text}]({to}{hash_}{anchor})"
        return text if text.strip("`") in target else f"{text} (`{target}`)"

    markdown = _SOURCE.sub(r'\1="', markdown) if here == "index.md" else markdown
    return _LINK.sub(resolved, markdown)


def commands() -> str:
    """Every command, its arguments and options, from typer."""
    parts = ["# Commands\n\nWhat `hoap3 … --help` says, in one page."]

    def below(command: Any, name: str) -> None:
        inner = getattr(command, "commands", None)
        if inner:
            for each in sorted(inner):
                below(inner[each], f"{name} {each}")
            return
        context = command.context_class(command, info_name=name)
        parts.append(f"## {name}\n\n```text\n{command.get_help(context)}\n```")

    below(command_line(), "hoap3")
    return "\n\n".join(parts)


def settings() -> str:
    """Every key of every config and of whatever one can name, from the models."""
    parts = [SETTINGS]
    topics = [(side, None) for side in SIDES]
    topics += [
        (kind, name) for kind, each in REGISTRIES.items() for name in sorted(each.registered())
    ]
    for kind, name in topics:
        rows = config_keys(kind, name)
        title = f"{kind} {name}" if name else f"config of the {kind}"
        lines = [
            f"## {title}",
            "",
            "| key | type | unit | default | meaning | changes while it runs |",
            "|---|---|---|---|---|---|",
        ]
        for row in rows:
            cells = [_cell(cell, code=place in (0, 3)) for place, cell in enumerate(row[:5])]
            lines.append(f"| {' | '.join((*cells, 'yes' if row.changes else ''))} |")
        parts.append("\n".join(lines) if rows else f"## {title}\n\nNo keys.")
    return "\n\n".join(parts)


def messages() -> str:
    """The schemas of what travels over the wire."""
    parts = ["# Messages\n\nROS 2 CDR, little endian. [The wire](wire.md) says how they travel."]
    parts += [
        f"## {message.schema.name}\n\n```text\n{message.schema.text.strip()}\n```"
        for message in (State, Setpoint, Target, Event)
    ]
    return "\n\n".join(parts)


def python() -> str:
    """What `import hoap3` gives, from the docstrings."""
    parts = ["# Python\n\nWhat `import hoap3` gives. All of it is loaded only when it is used."]
    for name in hoap3.__all__:
        each = getattr(hoap3, name)
        try:
            signature = str(inspect.signature(each))
        except (TypeError, ValueError):
            signature = ""
        parts.append(
            f"## {name}\n\n```text\n{name}{signature}\n\n{inspect.getdoc(each) or ''}\n```"
        )
    return "\n\n".join(parts)


def _cell(text: str, *, code: bool) -> str:
    escaped = text.replace("|", "\\|")
    return f"`{escaped}`" if code and escaped else escaped
