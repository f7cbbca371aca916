"""A page that stands alone: HTML with its style, its figures and its tables in one file.

It loads nothing: no script, no font, no image from elsewhere. Figures are SVG that take their colours from
the page, so that it reads on light and on dark screens and on paper.
"""

from __future__ import annotations

from dataclasses import dataclass, field
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
    """A figure on the page, and the files that hold it as well."""

    svg: str
    caption: str
    files: tuple[str, ...]
    """Relative to the page."""


@dataclass(frozen=True, slots=True)
class Section:
    """One theme: words, figures, tables."""

    title: str
    text: str = ""
    pictures: tuple[Picture, ...] = ()
    tables: tuple[Table, ...] = ()
    folded: bool = False
    """Tables are opened by the reader."""


@dataclass(frozen=True, slots=True)
class Fact:
    """One number that comes first."""

    name: str
    value: str
    unit: str = ""
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Page:
    """Everything on it, in order."""

    title: str
    subtitle: str
    badge: str = ""
    good: bool | None = None
    """What the badge says of it; None for neither."""
    lead: str = ""
    remarks: tuple[str, ...] = ()
    """What the reader must know before: damage, what is missing."""
    facts: tuple[Fact, ...] = ()
    sections: tuple[Section, ...] = ()
    footer: str = ""
    description: str = field(default="")


def save_figure(figure: Figure, folder: Path, name: str, caption: str) -> Picture:
    """Save a figure as PNG and PDF below `folder`; return it as it stands on a page.

    Raises
    ------
    RecordingError
        When a file cannot be written.
    """
    files = tuple(f"figures/{name}.{suffix}" for suffix in ("png", "pdf"))
    try:
        (folder / "figures").mkdir(parents=True, exist_ok=True)
        for file in files:
            figure.savefig(folder / file, metadata={"CreationDate": None} if file.endswith("pdf") else None)
    except OSError as error:
        raise RecordingError(str(folder), f"cannot be written: {error.strerror}") from None
    return Picture(svg_of(figure, name), caption, files)


def save_page(page: Page, path: Path) -> None:
    """Write a page.

    Raises
    ------
    RecordingError
        When the file cannot be written.
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
