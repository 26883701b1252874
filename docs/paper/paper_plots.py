"""Line plots as plain SVG text, the same to the last byte wherever they are made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from qsframework.plugin import Array

WIDTH, HEIGHT = 560.0, 330.0
LEFT, RIGHT, TOP, BOTTOM = 58.0, 20.0, 34.0, 46.0
COLOURS = ("#1f5fa8", "#c2571a", "#2f7d4f", "#8a3f8f", "#6b6b6b")


@dataclass(frozen=True, eq=False)
class Line:
    """One curve with its name; values outside the plot's range are cut off."""

    name: str
    x: Array
    y: Array


@dataclass(frozen=True)
class Band:
    """A range of x drawn as a bar at the height y, with a name at its right end."""

    name: str
    y: float
    low: float
    high: float
    colour: int = 4


@dataclass(frozen=True)
class Axes:
    """Title, names of the axes and their ranges with the ticks; the lines' names stand in the left or right corner."""

    title: str
    x_name: str
    y_name: str
    x_ticks: Sequence[float]
    y_ticks: Sequence[float]
    names_left: bool = False


def draw(axes: Axes, lines: Sequence[Line], bands: Sequence[Band] = ()) -> str:
    """The plot as an SVG document."""
    x0, x1 = axes.x_ticks[0], axes.x_ticks[-1]
    y0, y1 = axes.y_ticks[0], axes.y_ticks[-1]

    def px(x: float) -> float:
        return LEFT + (x - x0) / (x1 - x0) * (WIDTH - LEFT - RIGHT)

    def py(y: float) -> float:
        return HEIGHT - BOTTOM - (y - y0) / (y1 - y0) * (HEIGHT - TOP - BOTTOM)

    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img"'
        ' font-family="sans-serif" font-size="12">',
        f"<title>{escape(axes.title)}</title>",
        f'<rect width="{WIDTH:g}" height="{HEIGHT:g}" fill="#fff"/>',
        _text(LEFT, 18, axes.title, "start", 'font-weight="bold" '),
        _text((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 8, axes.x_name),
        f'<g transform="translate(14 {(TOP + HEIGHT - BOTTOM) / 2:.1f}) rotate(-90)">{_text(0, 0, axes.y_name)}</g>',
    ]
    for x in axes.x_ticks:
        out += [_rule(px(x), TOP, px(x), HEIGHT - BOTTOM), _text(px(x), HEIGHT - BOTTOM + 16, f"{x:g}")]
    for y in axes.y_ticks:
        out += [_rule(LEFT, py(y), WIDTH - RIGHT, py(y)), _text(LEFT - 6, py(y) + 4, f"{y:g}", "end")]
    for band in bands:
        colour = COLOURS[band.colour]
        out.append(
            f'<line x1="{px(band.low):.1f}" y1="{py(band.y):.1f}" x2="{px(band.high):.1f}" y2="{py(band.y):.1f}"'
            f' stroke="{colour}" stroke-width="7" stroke-opacity="0.45"/>'
        )
        out.append(_text(px(band.high) + 5, py(band.y) + 4, band.name, "start", f'fill="{colour}" '))
    for k, line in enumerate(lines):
        inside = (line.y >= y0) & (line.y <= y1)
        for run in _runs(inside):
            points = " ".join(f"{px(float(line.x[i])):.1f},{py(float(line.y[i])):.1f}" for i in run)
            out.append(f'<polyline fill="none" stroke="{COLOURS[k]}" stroke-width="2" points="{points}"/>')
        if len(lines) > 1:
            x, anchor = (LEFT + 8, "start") if axes.names_left else (WIDTH - RIGHT - 8, "end")
            out.append(_text(x, TOP + 16 + 16 * k, line.name, anchor, f'fill="{COLOURS[k]}" '))
    return "\n".join([*out, "</svg>"]) + "\n"


def _runs(inside: Array) -> list[Array]:
    """Indices of each stretch of points that can be drawn in one go."""
    index = np.flatnonzero(inside)
    return [run for run in np.split(index, np.flatnonzero(np.diff(index) > 1) + 1) if len(run) > 1]


def _text(x: float, y: float, words: str, anchor: str = "middle", more: str = "") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" {more}>{escape(words)}</text>'.replace(" >", ">")


def _rule(x1: float, y1: float, x2: float, y2: float) -> str:
    return f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="#ddd"/>'
