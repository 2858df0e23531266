"""One restrained look for all figures: colours, line styles, dressed axes; their files, and how a page holds them.

No pyplot, no backend and no rcParams are touched. Measured is black, before the calibration orange and dashed, after
it blue (after Okabe & Ito: distinct for colour-blind readers and in grey print).
"""

from __future__ import annotations

import base64
import io
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from mmg.messages import LOGGER, Message

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BEFORE, AFTER, MEASURED, GREY, ALARM = "#D58A00", "#0072B2", "#111111", "#8A8A8A", "#C0305A"
GRID = "#E4E4E4"
STYLES: tuple[dict, ...] = (
    {"color": BEFORE, "linestyle": (0, (4, 1.5))},
    {"color": AFTER},
    {"color": "#009E73", "linestyle": ":"},
)
# Of lines that are many: no two alike, so that a figure can be read in grey.
DASHES = ("-", (0, (6, 2)), (0, (2, 1.5)), (0, (7, 2, 1.5, 2)), (0, (3, 1, 1, 1, 1, 1)), (0, (1, 1)))
PNG = b"\x89PNG\r\n\x1a\n"  # How a PNG file begins (ISO/IEC 15948, 5.2)
# Letters as their outlines are: to fit them to pixels takes a sixth of the time of all figures.
LETTERS: dict[Any, Any] = {"text.hinting": "none"}


def new_figure(height: float, layout: Literal["constrained"] | None = "constrained") -> Figure:
    """A white figure 8.2 inches (900 pixels) wide and ``height`` inches high; layout: None where the caller places
    the axes."""
    from matplotlib.figure import Figure  # late: slow to import

    # 8.2 inch are 900 pixels, the width of a page
    return Figure(figsize=(8.2, height), dpi=110, layout=layout, facecolor="white")


def own_axes(ax: Axes | None, width: float = 6.4, height: float = 4.0) -> Axes:
    """``ax``, or axes of a new figure of this ``width`` and ``height`` [inch], which a notebook shows."""
    if ax is not None:
        return ax
    from matplotlib import pyplot  # late: slow to import

    return pyplot.subplots(figsize=(width, height), layout="constrained")[1]


class FigureFolder:
    """Figures and pages of a run whose numbers are written already: what fails is a warning, never a loss.

    folder: where PNG files go, made with the first one. rows: file, title and caption of each; failures: what could
    not be made, said on the way.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.rows: list[dict[str, str]] = []
        self.failures: list[Message] = []

    @contextmanager
    def making(self, what: str) -> Iterator[None]:
        """While it lasts, an error ends the making of ``what`` and is kept in ``failures``."""
        try:
            yield
        except Exception as error:
            why = " ".join(f"{type(error).__name__}: {error}".split())
            self.failures.append(Message(f"{what} could not be made ({why[:200]})", "figure_failed"))
            LOGGER.warning("warning: %s", self.failures[-1])

    def write(self, name: str, draw: Callable[[], Figure], title: str, caption: str) -> None:
        """Write the figure that ``draw`` gives as ``name``.png, with its ``title`` and ``caption``."""
        with self.making(f"figure {name}"):
            png = png_of(draw)
            self.folder.mkdir(parents=True, exist_ok=True)
            (self.folder / f"{name}.png").write_bytes(png)
            self.rows.append({"file": f"{name}.png", "title": title, "caption": caption})


def png_of(draw: Callable[[], Figure]) -> bytes:
    """The figure that ``draw`` gives as the content of a PNG file."""
    import numpy as np
    from matplotlib import rc_context  # late: slow to import
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    out = io.BytesIO()
    with warnings.catch_warnings(), rc_context(LETTERS):
        warnings.filterwarnings("ignore", "Glyph .* missing")  # a box stands for it
        figure = draw()
        canvas, layout = FigureCanvasAgg(figure), figure.get_layout_engine()
        if layout is not None:  # by hand: for it savefig draws everything twice
            layout.execute(figure)
            figure.set_layout_engine("none")
        canvas.draw()
    image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")  # the figure is white below
    few = image.quantize(128, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)  # a third of the bytes
    few.save(out, "png", compress_level=3, dpi=(figure.dpi, figure.dpi))  # a tenth larger, in two thirds of the time
    return out.getvalue()


def figures_of(folder: Path, listed: Any) -> list[dict]:
    """The figures ``listed`` in result.json with their content, from ``folder``/figures, as a data URI. ``image`` is
    None for one that is missing."""
    figures = []
    for entry in listed or []:
        path = folder / "figures" / Path(str(entry.get("file", ""))).name
        try:
            content = path.read_bytes()
        except OSError:
            content = b""
        title, caption = entry.get("title", path.stem), entry.get("caption", "")
        figures.append(figure_entry(content, path.stem, title, caption, path.name))
    return figures


def figure_entry(content: bytes, name: str, title: str, caption: str, file: str = "") -> dict[str, Any]:
    """One figure as the template takes it, with ``image`` None where ``content`` is no PNG file. name: by which it
    finds its section; title, caption: in words; file: its name in the run folder."""
    image = None
    if content.startswith(PNG):
        image = "data:image/png;base64," + base64.b64encode(content).decode()
    return {"title": title, "caption": caption, "image": image, "name": name, "file": file}


def literal(text: str) -> str:
    """``text`` from outside, such as the name of a trial, as a figure shows it: no formula begins in it."""
    return text.replace("$", r"\$")


def dress(ax: Axes, x: str = "", y: str = "", title: str = "") -> Axes:
    """Axes ``ax`` with labels ``x`` and ``y`` (with units), a ``title``, a light grid and no box."""
    ax.set_xlabel(x, fontsize=9)
    ax.set_ylabel(y, fontsize=9)
    ax.set_title(literal(title), fontsize=9.5, loc="left", fontweight="bold")
    ax.tick_params(labelsize=8, length=3, color=GREY)
    ax.grid(True, color=GRID, linewidth=0.6)
    ax.set_axisbelow(True)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        ax.spines[side].set_color(GREY)
    return ax
