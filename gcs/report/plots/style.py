"""Style of all figures: colours for colour-blind readers (after Okabe and Ito), light axes.

A figure is saved as PNG and PDF on white, and as SVG for a page. In the SVG, ink, axes and paper are
variables of the page's style sheet, so that it is readable on light and on dark.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from gcs.model import Cause, FloatArray, Kind

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Annotation
    from matplotlib.transforms import Bbox

AGENTS = (
    "#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#7a5cc0", "#8c6d31", "#1b9e9e",
    "#b03060",
)  # fmt: skip
KINDS: dict[Kind, str] = {"agents": "#0072b2", "targets": "#d55e00"}
TARGETS = "#4a5568"
RED = "#d7191c"
INK = "#1a202c"
GRID = "#e2e8f0"
AXIS = "#a0aec0"
CLUTTER = "#718096"
TRIGGERS: Final[dict[Cause, str]] = {
    "first plan": "#7a5cc0",
    "agent lost": RED,
    "agent down": "#8c1515",
    "agent unfit": "#d6604d",
    "agent not tracked": "#f4a582",
    "agent set aside": "#cc3377",
    "agent in danger": "#e69f00",
    "agent passed its target": "#cc79a7",
    "layer occupied": "#999933",
    "agent joined": "#009e73",
    "agent idle": "#56b4e9",
    "target appeared": "#0072b2",
    "target lost": "#d55e00",
    "target moved": "#8c6d31",
    "map changed": "#2f855a",
    "operator order": "#4c51bf",
    "taken up again": "#4a5568",
    "approved plan changed": "#b7950b",
    "upload waited": "#718096",
}
"""Colour of each trigger of plans, in the order of rows."""
_CORNERS = ((9, 7), (9, -16), (-9, 7), (-9, -16))
"""Places of a name next to its object, in points, the preferred one first."""
LABELLED = 12
"""Up to this number, objects of a kind are named and drawn in full size."""
_VARIABLES = {
    INK: "--ink", "#000000": "--ink", "#ffffff": "--paper", GRID: "--grid", AXIS: "--axis",
    TARGETS: "--target",
}  # fmt: skip
_COLOUR = re.compile("|".join(_VARIABLES))


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure, sizes in inches, that needs no display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    layout = ConstrainedLayoutEngine(h_pad=0.16, w_pad=0.08)  # inches, so that no heading is cut
    figure = Figure(figsize=(width, height), dpi=130, facecolor="white", layout=layout)
    FigureCanvasAgg(figure)
    return figure


def svg_of(figure: Figure, name: str) -> str:
    """Return a figure as an SVG element in the colours of its page."""
    from matplotlib import rc_context

    buffer = io.StringIO()
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": name}):
        figure.savefig(buffer, format="svg", transparent=True, metadata=nothing)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = _COLOUR.sub(lambda found: f"var({_VARIABLES[found[0]]})", text)
    text = re.sub(r"font(-family)?: ([^;\"]*?)'DejaVu Sans'[^;\"]*", r"font\1: \2var(--sans)", text)
    text = re.sub(r'(<svg [^>]*?)width="[^"]*"', r"\1", text, count=1)
    text = re.sub(r'(<svg [^>]*?)height="[^"]*"', r'\1role="img" ', text, count=1)
    return re.sub(r'id="(figure|axes|patch|text|line2d|legend|matplotlib|xtick|ytick)[^"]*"', "", text)


def colours(vehicles: Iterable[int]) -> dict[int, str]:
    """Return the colour of each agent; repeated in swarms."""
    return {vehicle: AGENTS[n % len(AGENTS)] for n, vehicle in enumerate(sorted(set(vehicles)))}


def size_for(count: int) -> float:
    """Return the scale of lines and marks: finer for large swarms."""
    return 1.0 if count <= LABELLED else 0.5


def dots(axes: Axes, points_m: FloatArray, **style: Any) -> None:
    """Draw (n, 2) points."""
    axes.scatter(points_m[:, 0], points_m[:, 1], **style)


def heading(axes: Axes, text: str) -> None:
    """Write the title of axes, with the unit."""
    axes.set_title(text, loc="left", fontsize=10, color=INK, pad=4)


def tidy(axes: Axes) -> None:
    """Draw light axes with a grid."""
    axes.grid(visible=True, color=GRID, lw=0.7)
    axes.set_axisbelow(True)
    axes.patch.set_alpha(0.0)
    axes.tick_params(labelsize=9, color=AXIS)
    for side, spine in axes.spines.items():
        spine.set_color(AXIS)
        spine.set_visible(side in ("left", "bottom"))


def annotate(axes: Axes, text: str, at_m: Sequence[float] | FloatArray, colour: str) -> Annotation:
    """Write the name of an object next to it."""
    return axes.annotate(
        text, (float(at_m[0]), float(at_m[1])), xytext=_CORNERS[0], textcoords="offset points", fontsize=10,
        fontweight="bold", color=colour, zorder=10,
        bbox={"boxstyle": "round,pad=0.12", "fc": "white", "ec": "none", "alpha": 0.75},
    )  # fmt: skip


def clear_names(axes: Axes, names: Sequence[Annotation], paths_m: Sequence[FloatArray]) -> None:
    """Move each name to the corner of its object where it covers the least of paths and other names."""
    place = axes.get_position()
    axes.apply_aspect()
    points_px = axes.transData.transform(np.concatenate([np.empty((0, 2)), *paths_m]))
    boxes: list[Bbox] = []
    for name in names:

        def covered(corner: tuple[int, int], name: Annotation = name) -> int:
            name.set(position=corner, horizontalalignment="left" if corner[0] > 0 else "right")
            box = name.get_window_extent()
            return box.count_contains(points_px) + 1000 * box.count_overlaps(boxes)

        covered(min(_CORNERS, key=covered))
        boxes.append(name.get_window_extent())
    axes.set_position(place)
    axes.set_in_layout(True)


def sample(label: str, **style: Any) -> Artist:
    """Return an entry of a legend."""
    from matplotlib.lines import Line2D

    return Line2D([], [], label=label, **{"ls": "none", "color": INK, **style})


def say(axes: Axes, text: str) -> None:
    """Write into empty axes the reason."""
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=TARGETS)


def legend(axes: Axes, **options: Any) -> None:
    """Draw a legend without a box."""
    axes.legend(**{"frameon": False, "fontsize": 9, "handletextpad": 0.5, "columnspacing": 1.3, **options})


def legend_below(axes: Axes, handles: Sequence[Artist], offset: float, rows: int = 1) -> None:
    """Draw a legend below axes; the offset is a fraction of their height."""
    columns = -(-len(handles) // rows)
    legend(
        axes, handles=handles, loc="upper center", bbox_to_anchor=(0.5, -offset), ncol=columns,
        borderaxespad=0.0,
    )  # fmt: skip
