"""The numbers of the source paper's Tables 1 to 5: what is printed, and the same computed with the library."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np
from paper_steps import loss_range, planar_rows, step_one_covariance, stiffness_rows

from qsframework.fits.two_step import step_two_information
from qsframework.plans import CRITERIA
from qsframework.plugin import Array

CRITERIA_NAMES = ("A", "D", "O3")
"""The paper's O1, O2 and O3, of `qsframework.plans.CRITERIA`."""

FITTED = (0.4722, 0.8609)
"""lc and l2, m, fitted to Table 2, because the paper prints neither."""
M900IB = (0.235, 1.12)
"""lc and l2 of the M-900iB, m; there b = 90 deg - q2."""
LINKS = (1.12, 1.285)
"""Link 2 and forearm in Tables 3 and 4, m."""
ENDS = (0.0, 120.0)
"""Range of q2 in all tables, deg; its ends are measured always."""
FOREARM = (-30.0, 30.0)
"""Elevations of the forearm in Tables 3 and 4, deg."""
MIDDLE = np.arange(1.0, 119.01, 0.1)
"""Middle angles of all curves, deg."""

COUNTS = (3, 4, 5)
"""Numbers of measurements in Table 1."""
TABLE_1 = {"A": (14.27, 9.85, 7.86), "D": (2.11, 1.68, 1.33), "O3": (8.19, 5.77, 4.59)}
"""Table 1: the criterion with three, four and five measurements."""
PER_CONFIGURATION = {"A": ("42.81", "39.4", "39.3"), "D": ("6.33", "6.72", "6.65"), "O3": ("24.57", "23.08", "22.95")}
"""Table 1: the criterion times the number of measurements, with the printed digits."""
BEST_VALUE = {name: values[0] for name, values in TABLE_1.items()}
"""Table 1, three measurements."""
RATIO = {"A": (1.0, 0.690, 0.551), "D": (1.0, 0.796, 0.630)}
"""Table 1, value with three, four and five measurements over that with three."""
BEST_MIDDLE = {"A": 47.1, "D": 50.0}
"""Section 5.2, deg: the ends of the range from 47.1 to 50.0."""
RANGES = {
    ("A", 0.1): (37.0, 57.0),
    ("A", 0.2): (35.0, 60.0),
    ("A", 0.5): (29.0, 67.0),
    ("D", 0.1): (33.0, 68.0),
    ("D", 0.2): (26.0, 75.0),
    ("D", 0.5): (17.0, 87.0),
}
"""Table 2, deg, the columns exchanged back."""
O3_RANGES = {0.1: (38.0, 57.0), 0.2: (34.0, 61.0), 0.5: (23.0, 75.0)}
"""Table 2, O3, deg."""
TABLE_2_BEST = {"A": ("47", "14.3"), "D": ("50", "2.11"), "O3": ("47", "8.2")}
"""Table 2, row min: the middle angle, deg, and the criterion, the columns exchanged back."""
TABLE_2_VALUE = {"A": ("15.7", "17.1", "21.4"), "D": ("2.32", "2.53", "3.16"), "O3": ("9.0", "9.8", "16.3")}
"""Table 2: the criterion at a loss of 10, 20 and 50 %."""
TABLE_3 = (
    (88.0, (0.66, 1.22, 2.00, 0.48, 0.45)),
    (67.0, (0.66, 1.22, 1.54, 0.47, 0.47)),
    (2.0, (0.71, 1.25, 0.71, 0.55, 0.50)),
    (67.0, (0.66, 1.22, 1.54, 0.47, 0.47)),
    (112.0, (0.67, 1.23, 1.62, 0.50, 0.44)),
)
"""Table 3: middle angle, deg, and the columns q2 = 0, q2 = 120, q2 = vary, q3 = -30, q3 = 30."""
K2_AT_88 = TABLE_3[0][1][2]
"""Table 3, sd of k2(88)."""
TABLE_4_BEST = ((88.0, 0.66), (67.0, 1.22), (2.0, 0.71), (67.0, 0.47), (112.0, 0.44))
"""Table 4, row min, in Table 3's columns: middle angle, deg, and value."""
_ALL = (0.0, 120.0)
TABLE_4 = {
    0.1: ((_ALL, 0.73), (_ALL, 1.34), ((0.0, 32.0), 0.78), ((20.0, 120.0), 0.52), ((53.0, 120.0), 0.48)),
    0.2: ((_ALL, 0.79), (_ALL, 1.46), ((0.0, 40.0), 0.85), (_ALL, 0.56), (_ALL, 0.53)),
    0.5: ((_ALL, 0.99), (_ALL, 1.83), ((0.0, 54.0), 1.06), (_ALL, 0.71), (_ALL, 0.66)),
}
"""Table 4: middle angles, deg, at which a column is at most so much above its least, and the value there."""
TABLE_4_LAST = {0.0: (47.0, 50.0), 0.1: (38.0, 57.0), 0.2: (35.0, 60.0), 0.5: (29.0, 67.0)}
"""Table 4, last column, deg: the parameters' range, from Table 2."""
COLUMN_ORDER = (0, 2, 1, 3, 4)
"""Of Table 3's columns in the order of `table_3`."""
CHOSEN = 35.0
"""The middle angle that the paper takes in the end, deg."""

Covariance = Callable[[Sequence[float]], Array | None]


def unweighted(angles: Sequence[float]) -> None:
    """Every aggregated stiffness is as good as every other: the paper's step two."""
    return None


def step_one(angles: Sequence[float]) -> Array:
    """Covariance (n, n) of the aggregated compliances k2 of step one, whose lever goes with |cos q2|.

    All stiffnesses are taken as large as one another, so their covariance is this one times a constant.
    """
    q2, q3 = (a.ravel() for a in np.meshgrid(np.deg2rad(angles), np.deg2rad(FOREARM), indexing="ij"))
    rows, first, _ = planar_rows(q2, q3, *LINKS)
    order = np.argsort(np.argsort(angles))
    return 1e12 * step_one_covariance(rows)[: len(first), : len(first)][np.ix_(order, order)]


def as_printed(q2: Array) -> Array:
    """b of (22) in the paper's tables: q2 itself."""
    return q2


def upright_base(q2: Array) -> Array:
    """b of (22) where the balancer's base line is upright, q2 being link 2's elevation."""
    return np.pi / 2 - q2


def step_two_value(
    criterion: str,
    angles: Sequence[float],
    covariance: Covariance = unweighted,
    sides: tuple[float, float] = FITTED,
    b: Callable[[Array], Array] = as_printed,
) -> float:
    """A criterion of [K2, Kc, s0 Kc] from aggregated stiffnesses at these q2, deg."""
    rows = stiffness_rows(b(np.deg2rad(np.asarray(angles))), *sides)
    return float(CRITERIA[criterion].value(step_two_information(rows, covariance(angles))))


@cache
def curve(criterion: str, covariance: Covariance = unweighted) -> Array:
    """The criterion at 0, each of the MIDDLE angles and 120 deg."""
    return np.array([step_two_value(criterion, (ENDS[0], middle, ENDS[1]), covariance) for middle in MIDDLE])


def best_middle(values: Array) -> float:
    """The middle angle of the least value, deg."""
    return float(MIDDLE[values.argmin()])


def loss_at(values: Array, middle: float) -> float:
    """How much worse than the best a middle angle is, as a share."""
    return float(np.interp(middle, MIDDLE, values) / values.min() - 1.0)


def best_angles(criterion: str, count: int, starts: int = 8) -> tuple[float, ...]:
    """The best `count` angles q2 in 0 to 120 deg, free of one another: coordinate exchange on a grid of 0.5 deg."""
    grid = np.arange(ENDS[0], ENDS[1] + 0.1, 0.5)
    rows = stiffness_rows(np.deg2rad(grid), *FITTED)
    each = rows[:, :, None] * rows[:, None, :]
    rng, found = np.random.default_rng(0), []
    for _ in range(starts):
        chosen, value = rng.choice(len(grid), count, replace=False), np.inf
        for _ in range(50):
            for k in range(count):
                rest = each[np.delete(chosen, k)].sum(axis=0)
                chosen[k] = scaled(criterion, rest + each).argmin()
            now = float(scaled(criterion, each[chosen].sum(axis=0)))
            if now >= value * (1.0 - 1e-12):
                break
            value = now
        found.append((value, tuple(sorted(float(a) for a in grid[chosen]))))
    return min(found)[1]


@cache
def paper_unit(criterion: str) -> float:
    """What the paper's A or D is of ours: by its three measurements, for it does not print its units."""
    return BEST_VALUE[criterion] / float(curve(criterion).min())


def scaled(criterion: str, M: Array) -> Array:
    """A criterion of information (..., 3, 3) in the paper's units; O3 is half the sum of A and D in these."""
    if criterion == "O3":
        return 0.5 * (scaled("A", M) + scaled("D", M))
    return paper_unit(criterion) * CRITERIA[criterion].value(M)


@cache
def paper_curve(criterion: str) -> Array:
    """`curve` in the paper's units."""
    rows = [stiffness_rows(np.deg2rad([ENDS[0], middle, ENDS[1]]), *FITTED) for middle in MIDDLE]
    return scaled(criterion, np.array([step_two_information(r) for r in rows]))


@dataclass(frozen=True)
class Table1:
    """For three, four and five measurements: the best angles, deg, the criterion in the paper's units, and over that of
    three."""

    angles: dict[str, tuple[tuple[float, ...], ...]]
    value: dict[str, tuple[float, ...]]
    ratio: dict[str, tuple[float, ...]]


@cache
def table_1() -> Table1:
    """Table 1 computed."""
    angles = {name: tuple(best_angles(name, count) for count in COUNTS) for name in CRITERIA_NAMES}
    value = {
        name: tuple(
            float(scaled(name, step_two_information(stiffness_rows(np.deg2rad(np.array(a)), *FITTED))))
            for a in angles[name]
        )
        for name in angles
    }
    return Table1(angles, value, {name: tuple(v / value[name][0] for v in value[name]) for name in angles})


def table_2(values: Array, loss: float) -> tuple[float, float]:
    """Between which middle angles a curve is at most `loss` above its best, deg."""
    return loss_range(MIDDLE, values, loss)


def table_3(middle: float) -> Array:
    """sd of k2(0), k2(middle), k2(120), k3(-30), k3(30) at sigma / F = 1 um/N, urad/(N m)."""
    return _sds((ENDS[0], middle, ENDS[1]))


def _sds(angles: Sequence[float]) -> Array:
    q2, q3 = (a.ravel() for a in np.meshgrid(np.deg2rad(angles), np.deg2rad(FOREARM), indexing="ij"))
    return 1e6 * np.sqrt(np.diag(step_one_covariance(planar_rows(q2, q3, *LINKS)[0])))


TABLE_4_ANGLES = np.concatenate([np.arange(0.1, 89.0, 0.1), np.arange(91.0, 119.95, 0.1)])
"""Middle angles of Table 4 and Figure 8, deg: at an upright link 2 its own compliance is not seen."""


@cache
def table_3_curves() -> Array:
    """Table 3's columns (n, 5) over the angles of Table 4, urad/(N m)."""
    return np.array([table_3(middle)[list(COLUMN_ORDER)] for middle in TABLE_4_ANGLES])


def table_4(loss: float, column: int = 2) -> tuple[float, float]:
    """Middle angles at which a column of Table 3 is at most `loss` above its least, deg: around the best one."""
    low, high = loss_range(TABLE_4_ANGLES, table_3_curves()[:, column], loss)
    return (ENDS[0] if low <= 0.1 else low), (ENDS[1] if high >= TABLE_4_ANGLES[-1] - 1e-9 else high)


def table_4_best(column: int) -> tuple[float, float]:
    """The middle angle, deg, at which a column of Table 3 is least, and its value there."""
    values = table_3_curves()[:, column]
    return float(TABLE_4_ANGLES[values.argmin()]), float(values.min())


@dataclass(frozen=True)
class OnTheRobot:
    """0, 35, 120 deg against the best three angles with b = 90 deg - q2 and the M-900iB's triangle."""

    angles: tuple[float, ...]
    times: float


def on_the_robot(criterion: str) -> OnTheRobot:
    """How many times the best value 0, 35, 120 deg has, weighted by step one."""
    angles, M = _weighted_designs()
    values = CRITERIA[criterion].value(M)
    taken = step_two_value(criterion, (ENDS[0], CHOSEN, ENDS[1]), step_one, M900IB, upright_base)
    return OnTheRobot(angles[int(values.argmin())], taken / float(values.min()))


@cache
def _weighted_designs(step: float = 2.5) -> tuple[list[tuple[float, ...]], Array]:
    """All designs of three distinct angles on a grid, deg, and their information (n, 3, 3) on the M-900iB."""
    grid = [float(a) for a in np.arange(ENDS[0], ENDS[1] + 0.1, step) if abs(a - 90.0) > 1.0]
    angles = list(combinations(grid, 3))
    rows = stiffness_rows(upright_base(np.deg2rad(np.array(angles))), *M900IB)
    white = np.linalg.solve(np.linalg.cholesky([step_one(three) for three in angles]), rows)
    return angles, np.swapaxes(white, 1, 2) @ white
