"""Pages of the documentation site that are not in docs/, and links that leave docs/.

mkdocs calls the functions whose names begin with ``on_`` (https://www.mkdocs.org/user-guide/configuration/#hooks).
Links in Markdown are those of the repository, so that they work in its web view. Here they are turned into
links of the site: files outside docs/ are copied to files/, folders become lists of their files.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import typer
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from typer.cli import get_docs_for_click

from gcs.cli import app as gcs
from sim_vehicles.cli import app as sim_vehicles

ROOT: Final = Path(__file__).parent
DOCS: Final = ROOT / "docs"
AT_ROOT: Final = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security-policy.md",
}
"""Markdown files at the root: their pages."""

PACKAGES: Final = ("gcs.tracking", "gcs.planning", "gcs.mavlink", "gcs.io.vehicles")
"""Packages whose public names (`__all__`) are documented."""

MERMAID: Final = ROOT / "node_modules" / "@mermaid-js" / "tiny" / "dist" / "mermaid.tiny.js"
"""The library that draws diagrams, of `npm ci`."""
_MERMAID_URI: Final = "assets/mermaid.js"

_LINK: Final = re.compile(r"(?<=\]\()([^)\s#]+)(?=[#)])")
_TABLE: Final = re.compile(r"(?:# )?\[\[?(\w+)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages, and the files outside docs/ that pages link to."""
    pages = {
        "reference/mission-file.md": mission_file_page(),
        "reference/command-line.md": command_line_page(),
        **{f"reference/{name}.md": f"# {name}\n\n::: {name}\n" for name in PACKAGES},
        **{page: (ROOT / name).read_text(encoding="utf-8") for name, page in AT_ROOT.items()},
    }
    for uri, text in pages.items():
        files.append(File.generated(config, uri, content=text))
    if MERMAID.is_file():
        files.append(File.generated(config, _MERMAID_URI, abs_src_path=str(MERMAID)))
    sources = [*(ROOT / name for name in AT_ROOT), *sorted(DOCS.rglob("*.md"))]
    for path in sorted({path for source in sources for path in linked(source)}):
        uri = uri_of(path)
        if path.is_dir():
            files.append(File.generated(config, uri, content=folder_page(path)))
        elif files.get_file_from_path(uri) is None:
            files.append(File.generated(config, uri, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Return the text of a page with links of the site in place of links of the repository."""
    uri = page.file.src_uri
    sources = {page_uri: ROOT / name for name, page_uri in AT_ROOT.items()}
    source = sources.get(uri, DOCS / uri)

    def link(match: re.Match[str]) -> str:
        path = target(source, match[1])
        return match[1] if path is None else os.path.relpath(uri_of(path), Path(uri).parent)

    # Python-Markdown shows the backslash of a `|` that is code in a table; GitHub needs it.
    return _LINK.sub(link, re.sub(r"`[^`\n]+`", lambda code: code[0].replace(r"\|", "|"), markdown))


def on_page_content(html: str, page: Page, files: Files, **_: Any) -> str:
    """Load mermaid from the site on pages with diagrams; without it show their text.

    The theme would load it from another host.
    """
    if 'class="mermaid"' not in html:
        return html
    library = files.get_file_from_path(_MERMAID_URI)
    if library is None:
        return html.replace('<pre class="mermaid">', "<pre>")
    return f'<script src="{library.url_relative_to(page.file)}"></script>\n{html}'


def target(source: Path, link: str) -> Path | None:
    """Return the file or folder of the project that a link in `source` leads to."""
    path = (source.parent / link).resolve()
    return path if path.is_relative_to(ROOT) and path.exists() else None


def linked(source: Path) -> Iterator[Path]:
    """Yield the files and folders of the project that a page links to."""
    for link in _LINK.findall(source.read_text(encoding="utf-8")):
        path = target(source, link)
        if path is not None:
            yield path


def uri_of(path: Path) -> str:
    """Return the place of a file or folder of the project in the site."""
    name = path.relative_to(ROOT).as_posix()
    if name == "config/reference.toml":
        return "reference/mission-file.md"
    uri = AT_ROOT.get(name) or (name.removeprefix("docs/") if path.is_relative_to(DOCS) else f"files/{name}")
    return f"{uri}/index.md" if path.is_dir() else uri


def folder_page(folder: Path) -> str:
    """Return a page with links to the files of a folder, by title where they have one."""
    title = folder.name.capitalize()
    lines = [f"- [{title_of(path)}]({path.name})" for path in sorted(folder.iterdir()) if path.is_file()]
    return "\n".join([f"# {title}\n", *lines, ""])


def title_of(path: Path) -> str:
    """Return the title of a Markdown file, or the name of another file."""
    is_page = path.suffix == ".md"
    return path.read_text(encoding="utf-8").partition("\n")[0].strip("# ") if is_page else path.name


def mission_file_page() -> str:
    """Return the page of the mission file: a section for each table of config/reference.toml."""
    text = (ROOT / "config" / "reference.toml").read_text(encoding="utf-8")
    intro, _, body = text.partition("\n\n")
    parts: dict[str, str] = {"Top level": ""}
    name = "Top level"
    for paragraph in body.split("\n\n"):
        if paragraph.startswith("# The simulated world"):
            name = "simulation"
        name = _TABLE.findall(paragraph)[0] if _TABLE.match(paragraph) else name
        parts[name] = f"{parts.get(name, '')}{paragraph.strip()}\n\n"
    lead = "\n".join(line.lstrip("# ") for line in intro.splitlines())
    sections = [f"## {name}\n\n```toml\n{part.rstrip()}\n```\n" for name, part in parts.items()]
    return "\n".join(["# Mission file\n", lead, "", *sections])


def command_line_page() -> str:
    """Return the page of all commands, made from their help."""
    parts = ["# Command line\n"]
    for name, one in (("gcs", gcs), ("sim-vehicles", sim_vehicles)):
        program = typer.main.get_command(one)
        context = program.context_class(program, info_name=name)
        for command in program.list_commands(context):
            _, found, _ = program.resolve_command(context, [command])
            inner = found.context_class(found, parent=context, info_name=command)
            parts.append(get_docs_for_click(obj=found, ctx=inner, indent=1, name=command, call_prefix=name))
    return "\n".join(parts)
