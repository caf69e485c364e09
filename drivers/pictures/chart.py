"""Charts of measured points and curves, drawn by matplotlib (extra `plot`): a picture comes out.

The only door to matplotlib. The same charts are the same picture, whatever style a user has set.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from evs.drivers.pictures.image_files import suffix_of
from evs.msgs import EvsError
from evs.msgs.pictures import INK, U8

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis

RGB = tuple[int, int, int]
INK_RGB: RGB = (INK, INK, INK)
GREY: RGB = (120, 120, 120)

HEADING_PX = 70
LEVELS = 17
"""colours of a picture: more are hard to distinguish, and make files large"""
_DPI = 100
_PT = 72 / _DPI
"""points of a px"""
_NONE = "#969696"
"""colour of a pixel without a value"""


@dataclass(frozen=True)
class Scale:
    """One axis. Logarithmic ones have low > 0."""

    low: float
    high: float
    log: bool = False
    unit: str = ""
    """follows each number, with a prefix (k, m, u ...)"""
    shown: tuple[float, ...] = ()
    """the numbers at the ticks; empty: round ones"""


@dataclass(frozen=True)
class Series:
    """Values of y over x: measured points, or a reference line."""

    x: Sequence[float]
    y: Sequence[float]
    colour: RGB
    label: str = ""
    """for the legend; empty: it has none"""
    line: bool = False
    """a line through them; else points"""
    error: Sequence[float] = ()
    """half the length of each point's bar"""
    ring_px: float = 0.0
    """points: rings of this radius around other points; 0: marks"""
    mark: str = "o"
    """points: a marker of matplotlib, or "circle", an empty disc"""
    x_range: Sequence[tuple[float, float]] = ()
    """points: (low, high) of each one's bar along x"""


@dataclass(frozen=True)
class Chart:
    """The content of one panel."""

    title: str
    x: Scale
    y: Scale
    x_label: str
    series: Sequence[Series] = ()
    marks: Sequence[tuple[float, str]] = ()
    """levels of y with a dashed line, and its text"""
    posts: Sequence[tuple[float, str]] = ()
    """levels of x with a dashed line, and its text"""
    empty: str = ""
    """text where there is nothing to show"""
    picture: npt.NDArray[np.float64] | None = None
    """(h, w) values in place of the axes, coloured by `y`; NaN is grey"""
    colours: str = "RdBu_r"
    """of the picture: a colour map of matplotlib"""


def need_plot() -> Any:
    """matplotlib; EvsError with the fix where it is not installed."""
    try:
        import matplotlib.backends.backend_agg
        import matplotlib.figure
        import matplotlib.style
        import matplotlib.ticker
    except ImportError:
        raise EvsError("charts need matplotlib: pip install 'evs[plot]'") from None
    return matplotlib


def check_chart_file(path: Path | None) -> None:
    """EvsError unless a chart can be drawn into this file; nothing if there is none."""
    if path is not None:
        if suffix_of(path) != ".png":
            raise EvsError(f"--picture is '{path}': end it in .png")
        need_plot()


def draw_charts(
    charts: Sequence[Chart],
    columns: int,
    size: tuple[int, int],
    heading: str = "",
    about: str = "",
    finish: Callable[[Axes, int], object] | None = None,
) -> U8:
    """Draw charts on one page, row by row.

    Args:
        charts: What is drawn.
        columns: Charts of a row.
        size: Width and height of each, px.
        heading: Of the page, HEADING_PX high; empty: it has none.
        about: A line below it.
        finish: Called with the axes of each chart and its index, once the layout is known.

    Returns:
        (height, width, 3).

    Raises:
        EvsError: matplotlib is not installed.
    """
    plot = need_plot()
    rows, top = -(-len(charts) // columns), HEADING_PX if heading else 0
    width, height = columns * size[0], rows * size[1] + top
    with plot.style.context("default"):
        figure = plot.figure.Figure((width / _DPI, height / _DPI), _DPI, layout="constrained")
        canvas = plot.backends.backend_agg.FigureCanvasAgg(figure)
        figure.get_layout_engine().set(w_pad=0.12, h_pad=0.1, rect=(0, 0, 1, 1 - top / height))
        figure.text(16 / width, 1 - 26 / height, heading, fontsize=19, va="center")
        figure.text(16 / width, 1 - 55 / height, about, fontsize=11, va="center")
        panels = list(figure.subplots(rows, columns, squeeze=False).flat)
        for axes, chart in zip(panels, charts, strict=False):
            _draw(plot, axes, chart)
        for axes in panels[len(charts) :]:
            axes.remove()
        if finish is not None:
            figure.draw_without_rendering()
            figure.set_layout_engine("none")
            for index in range(len(charts)):
                finish(figure.axes[index], index)
        canvas.draw()
        return np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])


def colour_of(rgb: RGB) -> tuple[float, float, float]:
    """A colour as matplotlib has it."""
    red, green, blue = (part / 255 for part in rgb)
    return red, green, blue


def _draw(plot: Any, axes: Axes, chart: Chart) -> None:
    axes.set_title(chart.title, loc="left", fontsize=11)
    axes.set_xlabel(chart.x_label)
    if chart.picture is not None:
        norm = plot.colors.LogNorm if chart.y.log else plot.colors.Normalize
        colours = plot.colormaps[chart.colours].resampled(LEVELS).with_extremes(bad=_NONE)
        scale = norm(chart.y.low, chart.y.high, clip=True)
        image = axes.imshow(chart.picture, cmap=colours, norm=scale, interpolation="nearest")
        axes.set(xticks=[], yticks=[])
        bar = axes.figure.colorbar(image, ax=axes)
        _ticks(plot, bar.ax.yaxis, chart.y)
        return
    axes.grid(color="#e8e8e8")
    axes.set_axisbelow(True)
    for axis, scale in (("x", chart.x), ("y", chart.y)):
        if scale.log:
            axes.set(**{f"{axis}scale": "log"})
        axes.set(**{f"{axis}lim": (scale.low, scale.high)})
        _ticks(plot, getattr(axes, f"{axis}axis"), scale)
    for level, words in chart.marks:
        axes.axhline(level, color=colour_of(GREY), ls="--", lw=1)
        where = axes.get_yaxis_transform()
        axes.text(0.99, level, words, transform=where, ha="right", va="bottom", fontsize=9)
    for level, words in chart.posts:
        axes.axvline(level, color=colour_of(GREY), ls="--", lw=1)
        where = axes.get_xaxis_transform()
        axes.text(level, 0.99, f" {words}", transform=where, va="top", fontsize=9)
    for series in chart.series:
        _series(axes, series)
    if any(series.label for series in chart.series):
        axes.legend(fontsize=9, framealpha=0.7)
    if chart.empty:
        axes.text(0.5, 0.5, chart.empty, transform=axes.transAxes, ha="center", va="center")


def _ticks(plot: Any, axis: Axis, scale: Scale) -> None:
    if scale.unit:
        axis.set_major_formatter(plot.ticker.EngFormatter(scale.unit))
        axis.set_minor_formatter(plot.ticker.NullFormatter())
        if scale.log and scale.high < 100 * scale.low:
            axis.set_major_locator(plot.ticker.LogLocator(subs=(1, 2, 5)))
    if scale.shown:
        axis.set_ticks(scale.shown, [f"{value:g}" for value in scale.shown])
        axis.set_ticks([], minor=True)


def _series(axes: Axes, series: Series) -> None:
    x, y = np.asarray(series.x, float), np.asarray(series.y, float)
    style: dict[str, Any] = {"color": colour_of(series.colour), "label": series.label or None}
    if series.line:
        axes.plot(x, y, lw=1.5, **style)
        return
    size = 2 * (series.ring_px or 3.5) * _PT
    mark = "o" if series.mark == "circle" else series.mark
    if series.ring_px or mark != series.mark:
        style["markerfacecolor"] = "none" if series.ring_px else "white"
    ends = np.reshape(np.asarray(series.x_range, float), (-1, 2))
    spread = np.abs(ends.T - x) if len(ends) else None
    error = series.error if len(series.error) else None
    axes.errorbar(x, y, error, spread, fmt=mark, ms=size, elinewidth=0.8, **style)


def decades_around(values: list[float], least: float = 1.0) -> tuple[float, float]:
    """(low, high): powers of ten around the positive ones among them, `least` decades apart."""
    good = [value for value in values if math.isfinite(value) and value > 0.0]
    if not good:
        return 0.1, 10.0
    low = math.floor(math.log10(min(good)) + 1e-9)
    high = math.ceil(math.log10(max(good)) - 1e-9)
    return 10.0**low, 10.0 ** max(high, low + least)
