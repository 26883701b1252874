"""What a model misses at the markers, in 3D: before a fit or an extension, and after it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qsframework.experiment import Experiment, Readings
from qsframework.plugin import Array, Indices
from qsframework.report.blocks import ReportTable, SceneView


def residual_view(
    experiment: Experiment,
    readings: Readings,
    kept: Indices,
    residuals: tuple[Array, Array],
    names: tuple[str, str],
    look: str,
    causes: Sequence[str] = (),
) -> SceneView:
    """The poses with the largest residuals, with arrows at their markers, and all poses in numbers, in the same order.

    kept (R,): rows of the readings; residuals: before and after (R, 3) m, with their names; look: what to look for;
    causes: `effect[where]` of a diagnosis, which glow where they act
    """
    from qsframework.viz import residual_scene
    from qsframework.viz.residual_scene import MOST

    scene, factor = residual_scene(experiment, readings, kept, *residuals, causes)
    at = readings.plus[kept]
    sizes = [1e3 * np.linalg.norm(v, axis=1) for v in residuals]
    worst = {m: [float(s[at == m].max()) for s in sizes] for m in map(int, np.unique(at))}
    own = readings.states
    rows = tuple(
        (own.pose[m], str(int(own.repeat[m])), *(f"{v:.4f}" for v in worst[m]))
        for m in sorted(worst, key=lambda m: -worst[m][0])
    )
    shown = "all poses" if len(worst) <= MOST else f"the {MOST} poses with the largest residuals"
    return SceneView(
        scene.html(),
        f"Measured minus predicted at the markers, {factor:.0f} times enlarged: red {names[0]}, green {names[1]}; "
        f"{shown}, the slider shows one at a time. {look}",
        ReportTable(
            ("pose", "repeat", f"largest {names[0]}, mm", f"{names[1]}, mm"),
            rows,
            "Lengths of the vectors, worst first.",
        ),
        scene.poses,
    )
