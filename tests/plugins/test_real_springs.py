"""The R-2000iC's readings: two physical springs with compliances above zero, chosen inside the leave-one-out."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from qsframework.experiment import Experiment, Readings
from qsframework.plugin import find


def test_nested_leave_one_out_reaches_0_16_mm(r2000ic: Experiment, real: Readings) -> None:
    facts = r2000ic.robot.facts
    springs = [s for name in ("offaxis_compliance", "flange_compliance") for s in find(name).places(facts)]
    experiment = r2000ic.with_(
        effects=tuple(springs), parameters=tuple(p for s in springs for p in s.parameters(facts))
    )
    names = experiment.spring_names()
    A = experiment.model().sensitivity(real.poses, names=names, linear=True)[real.plus, real.marker]
    y = real.value
    base = [i for i, n in enumerate(names) if n.startswith("joint_")]
    extra = [i for i in range(len(names)) if i not in base]

    def fit(columns: list[int], rows: list[int]) -> np.ndarray:
        B = A[rows][:, :, columns].reshape(-1, len(columns))
        size = np.linalg.norm(B, axis=0)
        return nnls(B / size, y[rows].ravel())[0] / size

    def error(columns: list[int], rows: list[int], at: int) -> float:
        return float(((y[at] - A[at][:, columns] @ fit(columns, rows)) ** 2).sum())

    def choose(rows: list[int]) -> list[int]:
        """Forward selection of two springs by leave-one-out among `rows` only."""
        columns = list(base)
        for _ in range(2):
            columns.append(
                min(
                    (k for k in extra if k not in columns),
                    key=lambda k: sum(error([*columns, k], [r for r in rows if r != i], i) for i in rows),
                )
            )
        return columns

    everything = list(range(len(y)))
    total = 0.0
    for i in everything:
        rows = [r for r in everything if r != i]
        total += error(choose(rows), rows, i)
    assert np.sqrt(total / y.size) * 1e3 <= 0.16
    assert {names[k] for k in choose(everything)[6:]} == {"offaxis_compliance[joint_3/x]", "flange_compliance[y]"}
