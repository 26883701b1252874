"""Where in the workspace the errors are: maps before and after, of the same rows in one scale of colours."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np

from qsframework.experiment import Experiment
from qsframework.experiment.observations import ReadingRows
from qsframework.plugin import Array
from qsframework.report.blocks import Figure, Plot
from qsframework.report.numbers import row_table
from qsframework.report.plots import GREY, ORANGE, SKY, panels


def error_maps(experiment: Experiment, rows: ReadingRows, errors: Mapping[str, Array]) -> tuple[Figure, ...]:
    """`placed_maps` where the nominal arm has the markers of the rows."""
    return placed_maps(rows.places(experiment), rows.pose_names, errors)


def placed_maps(places: Array, poses: Sequence[str], errors: Mapping[str, Array]) -> tuple[Figure, ...]:
    """The 3D errors (R, 3) m of each name at places (R, 3) m, base frame, in one scale of colours; none where no row
    was read along all axes. poses: names of the poses (R,)."""
    seen = np.flatnonzero(np.isfinite(np.stack([*errors.values()])).all(axis=(0, 2)))
    if not len(seen):
        return ()
    points = places[seen]
    around = np.hypot(points[:, 0], points[:, 1])
    names = [poses[i] for i in seen.tolist()]
    sizes = {name: 1e3 * np.linalg.norm(values[seen], axis=1) for name, values in errors.items()}
    views = {"from above": (*points.T[:2], "x, m", "y, m"), "from the side": (around, points[:, 2], "r, m", "z, m")}
    columns = [names, *points.T.tolist(), around.tolist(), *(size.tolist() for size in sizes.values())]
    header = ("pose", "x, m", "y, m", "z, m", "from the axis, m", *(f"{name}, mm" for name in sizes))
    maps = Figure(
        _maps(names, sizes, views),
        "The same places before and after, in one scale; r is the distance from the base's axis. Look in the lower "
        "maps for a corner of the workspace in which all are large: there the model misses something, or the poses "
        "were too few.",
        row_table(header, columns),
        wide=True,
    )
    return (maps,)


def _maps(names: Sequence[str], sizes: dict[str, Array], views: dict[str, tuple[Any, ...]]) -> Plot:
    """Circles at places, a map for each kind of size (R,) mm, from each side, in one scale of colours."""
    largest = max(*(float(size.max()) for size in sizes.values()), 1e-9)
    titles = [f"{name}: {view}" for name in sizes for view in views]
    figure = panels("Errors over the workspace", 2, 2, titles, 780, 0.12, shared=False, heights=[0.5, 0.5])
    for k, (size, (x, y, along, up)) in enumerate(product(sizes.values(), views.values())):
        row, col = k // 2 + 1, k % 2 + 1
        order: list[int] = np.argsort(size).tolist()  # the largest are drawn last
        poses = [html.escape(names[i]) for i in order]
        figure.add_scatter(
            x=x[order],
            y=y[order],
            mode="markers",
            showlegend=False,
            customdata=poses,
            text=[f"pose {name}: {size[i]:.3f} mm" for name, i in zip(poses, order, strict=True)],
            hovertemplate="%{text}<extra></extra>",
            marker={
                "size": 5.0 + 13.0 * size[order] / largest,
                "symbol": "circle",
                "color": size[order],
                "coloraxis": "coloraxis",
                "line": {"width": 0.5, "color": GREY},
                "opacity": 0.85,
            },
            row=row,
            col=col,
        )
        figure.update_xaxes(row=row, col=col, title={"text": along})
        figure.update_yaxes(row=row, col=col, title={"text": up}, scaleanchor=f"x{k + 1}" if k else "x")
    scale = {"colorscale": [[0.0, SKY], [1.0, ORANGE]], "colorbar": {"title": {"text": "mm"}, "thickness": 12}}
    figure.update_layout(coloraxis={**scale, "cmin": 0.0, "cmax": largest}, margin={"t": 76})
    return figure
