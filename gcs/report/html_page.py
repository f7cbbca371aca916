"""Self-contained HTML page: style, figures and tables in one file.

It loads nothing from elsewhere. Figures are SVG in the colours of the page, readable on light and dark
screens and on paper.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gcs.errors import RecordingError
from gcs.report.plots.style import svg_of
from gcs.report.run.tables import Table
from gcs.safe_text import printable

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class Picture:
    """Figure on the page, and its other files."""

    svg: str
    caption: str
    files: tuple[str, ...]
    """Relative to the page."""


@dataclass(frozen=True, slots=True)
class Section:
    """One topic: text, figures, tables."""

    title: str
    text: str = ""
    pictures: tuple[Picture, ...] = ()
    tables: tuple[Table, ...] = ()
    folded: bool = False
    """True if the tables are folded."""


@dataclass(frozen=True, slots=True)
class Fact:
    """One key figure."""

    name: str
    value: str
    unit: str = ""
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Page:
    """Content of a page, in order."""

    title: str
    subtitle: str
    badge: str = ""
    good: bool | None = None
    """Colour of the badge: True for success, False for failure, None for neither."""
    lead: str = ""
    remarks: tuple[str, ...] = ()
    """Warnings about the data: damage, missing parts."""
    facts: tuple[Fact, ...] = ()
    sections: tuple[Section, ...] = ()
    footer: str = ""


def save_figure(figure: Figure, folder: Path, name: str, caption: str) -> Picture:
    """Save a figure as PNG and PDF below `folder`; return it for a page.

    Raises
    ------
    RecordingError
        If a file cannot be written.
    """
    files = tuple(f"figures/{name}.{suffix}" for suffix in ("png", "pdf"))
    try:
        (folder / "figures").mkdir(parents=True, exist_ok=True)
        for file in files:
            figure.savefig(folder / file, metadata={"CreationDate": None} if file.endswith("pdf") else None)
            figure.set_layout_engine("none")  # a layout costs a third of a file: it stays that of the first
    except OSError as error:
        raise RecordingError(str(folder), f"cannot be written: {error.strerror}") from None
    return Picture(svg_of(figure, name), caption, files)


def save_page(page: Page, path: Path) -> None:
    """Write a page.

    Raises
    ------
    RecordingError
        If the file cannot be written.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("gcs.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    try:
        text = environment.get_template("page.html").render(page=page)
        path.write_text(printable(text, keep="\n\t"), encoding="utf-8")
    except OSError as error:
        raise RecordingError(str(path), f"cannot be written: {error.strerror}") from None
