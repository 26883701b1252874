"""Write paper-tables.md: the source paper's tables, printed and computed side by side. Run: python docs/make_paper.py

The designed poses are the only thing here that takes a solver; they are read back from the page (`--keep`), so that
everything else can be made anew in a second.
"""

from __future__ import annotations

import re
import sys
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import paper_numbers as paper
import paper_plots as plots
import paper_table5 as table5

from qsframework.design import design
from qsframework.plugin import Array

HERE = Path(__file__).resolve().parent
PAGE = HERE / "paper-tables.md"
IMAGES = HERE / "images"
POSES, CANDIDATES, SEED = 12, 1000, 0
LOSSES = (0.1, 0.2, 0.5)
TITLES = {"A": "O1, the trace (A)", "D": "O2, the determinant's cube root (D)", "O3": "O3, half their sum"}
UNKNOWN = "–"
"""A printed cell that our notes on the paper do not hold."""
TICKS = tuple(range(0, 121, 20))


@dataclass(frozen=True, eq=False)
class Designed:
    """What the solver gave, pendant angles in deg to one digit: the plan against Table 5, and poses for joint 1."""

    plan: Array
    side: Array
    side_among_unknown: Array


def solve() -> Designed:
    """Design the poses anew: some seconds."""
    plan = design(table5.vertical(), POSES, "D", candidates=CANDIDATES, seed=SEED)
    side = design(table5.side_pull(False), 1, "D", candidates=CANDIDATES, seed=SEED)
    found = (plan.repeated().pendant, side.pendant)
    return Designed(*(rounded(np.rad2deg(pendant)) for pendant in found), rounded(table5.climb(table5.told_of_joint_1)))


def rounded(pendant_deg: Array) -> Array:
    """To the digit that the page prints, so that its numbers follow from its poses."""
    return np.round(pendant_deg, 2) + 0.0


def read_designed(text: str) -> Designed:
    """The designed poses that stand in the page."""

    def poses(name: str) -> Array:
        block = text.split(f"<!-- poses: {name} -->\n")[1].split("\n\n")[0]
        rows = [re.findall(r"-?\d+\.\d+", line) for line in block.splitlines()[2:]]
        return np.array([[float(v) for v in row] for row in rows])

    return Designed(poses("plan"), poses("side"), poses("side among unknown"))


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])


def pose_table(name: str, pendant_deg: Array) -> str:
    """Pendant angles, found again by `read_designed`."""
    rows = [[str(i + 1), *(f"{a:.2f}" for a in pose)] for i, pose in enumerate(pendant_deg)]
    return f"<!-- poses: {name} -->\n" + table(["pose", *(f"J{k}, deg" for k in range(1, 7))], rows)


def degrees(angles: Iterable[float], digits: int = 1) -> str:
    return ", ".join(f"{a:.{digits}f}".removesuffix(".0") for a in angles)


def span(ends: tuple[float, float] | None, digits: int = 0) -> str:
    return UNKNOWN if ends is None else f"{ends[0]:.{digits}f} to {ends[1]:.{digits}f}"


def tables_1_and_2(curves: dict[str, Array]) -> str:
    """Sections on Tables 1 and 2."""
    one = paper.table_1()
    rows = []
    for k, count in enumerate((3, 4, 5)):
        row = [str(count)]
        for name in ("A", "D"):
            row += [f"{paper.RATIO[name][k]:.3f}", f"{one.ratio[name][k]:.3f}", degrees(one.angles[name][k])]
        rows.append(row)
    head = ["measurements", "A printed", "A computed", "best q2, deg", "D printed", "D computed", "best q2, deg"]
    middles = [
        [
            TITLES[name],
            f"{paper.BEST_VALUE[name]:.2f}",
            f"{curves[name].min():.2f}",
            f"{paper.BEST_MIDDLE[name]:.1f}" if name in paper.BEST_MIDDLE else UNKNOWN,
            f"{paper.best_middle(curves[name]):.1f}",
        ]
        for name in paper.CRITERIA_NAMES
    ]
    ranges = [
        [
            f"{loss:.0%}",
            *(
                cell
                for name in paper.CRITERIA_NAMES
                for cell in (span(paper.RANGES.get((name, loss))), span(paper.table_2(curves[name], loss), 1))
            ),
        ]
        for loss in LOSSES
    ]
    best = paper.BEST_VALUE["O3"]
    return f"""## Table 1: how many angles, and which

The criterion over that of three measurements. All angles are free between 0 and 120 deg; the best four and five repeat
the best three.

{table(head, rows)}

With three measurements, 0 and 120 deg being the outer ones:

{table(["criterion", "value printed", "value computed", "middle q2 printed, deg", "computed, deg"], middles)}

The values differ by a constant for each criterion, because the paper does not say its units; the ratios and angles of A
and D do not depend on it, those of O3 by less than 1 deg. D depends on lc / l2 only; A's best angle moves by 1 to 3 deg
if both lengths are halved or doubled.

## Table 2: how far the middle angle may be off

Middle angles (deg) at which the criterion is at most so much above its best. The paper's columns O1 and O2 are
exchanged back (see the [errors in print](paper.md#errors-in-print)).

{table(["loss", *(f"{c} {w}" for c in paper.CRITERIA_NAMES for w in ("printed", "computed"))], ranges)}

The last row prints {paper.O3_LAST_ROW} for O3 at 50 %; from a best of {best} that is {paper.O3_LAST_ROW / best:.2f}
times the best, a loss of 100 %. At 50 % it is {1.5 * best:.1f}."""


def figures() -> str:
    return """## Figures 6 to 8: the criteria against the middle angle

The loss against the best middle angle, q2 = 0 and 120 deg being the other two. Bars: the ranges of Table 2, computed
(grey) and printed (orange). The valley is flat for the determinant and steep for the trace, so the trace decides.

![O1, the trace, against the middle angle](images/paper-A.svg)

![O2, the determinant's cube root, against the middle angle](images/paper-D.svg)

![O3, half their sum, against the middle angle](images/paper-O3.svg)"""


def tables_3_and_4() -> str:
    """Sections on Tables 3 and 4."""
    middles = (20.0, 30.0, 35.0, 40.0, 47.0, 60.0, 88.0)
    names = ["k2(0)", "k2(middle)", "k2(120)", "k3(-30)", "k3(30)"]
    cells = np.array([paper.table_3(m) for m in middles])
    rows = [[name, *(f"{v:.2f}" for v in cells[:, k])] for k, name in enumerate(names)]
    printed = [
        "k2(middle), printed",
        *[UNKNOWN] * (len(middles) - 1),
        f"{paper.K2_AT_88:.2f} (error in print)",
    ]
    rows.insert(2, printed)
    ranges = [[f"{loss:.0%}", span(paper.TABLE_4_RANGE.get(loss)), span(paper.table_4(loss), 1)] for loss in LOSSES]
    return f"""## Table 3: what step one tells

The sd of five aggregated compliances, urad/(N m), from six planar poses: q2 = 0, middle, 120 deg with the forearm at
-30 and 30 deg, a vertical force, sigma / F = 1 um/N, l2 = 1.12 m, l3 = 1.285 m. Columns: the middle angle, deg.

{table(["sd of", *(f"{m:g}" for m in middles)], rows)}

The cell at 88 deg cannot be: with link 2 nearly upright the force has a lever of l2 |cos q2| = 0.04 m, and the sd grows
as 1 / |cos q2|. Our notes hold this printed cell only, and the finding that every other agrees with the computed one
within 0.01.

![sd of the five compliances against the middle angle](images/paper-sd.svg)

## Table 4: how far the middle angle may be off for step one

Middle angles (deg) at which the sd of k2(middle) is at most so much above its best, which lies next to 0.

{table(["loss", "printed", "computed"], ranges)}

Our notes hold the row of 20 % only, and the finding that every printed end agrees within 0.6 deg."""


def thirty_five(curves: dict[str, Array], weighted: dict[str, Array]) -> str:
    """Section on the step from 47-50 deg to 35 deg."""
    rows = [
        [
            TITLES[name],
            f"{paper.best_middle(curves[name]):.1f}",
            f"{paper.best_middle(weighted[name]):.1f}",
            f"{paper.loss_at(weighted[name], paper.CHOSEN):.1%}",
            f"{paper.loss_at(weighted[name], 48.0):.1%}",
        ]
        for name in paper.CRITERIA_NAMES
    ]
    robot = {name: paper.on_the_robot(name) for name in ("A", "D")}
    best = [[name, degrees(found.angles), f"{found.times:.2f}"] for name, found in robot.items()]
    head = ["criterion", "best middle, alike", "best middle, weighted", "loss at 35", "loss at 48"]
    return f"""## Why 35 deg and not 47 to 50

Table 5 measures at 0, 35 and 120 deg. On paper the ranges of 20 % of Table 2 (trace, 35 to 60 deg) and of Table 4 (0 to
40 deg) meet in 35 to 40. The substance behind it: Tables 1 and 2 weigh every aggregated stiffness alike, but step one
knows k2 the worse the more upright link 2 stands. With step one's covariance as the weight (the stiffnesses taken
as equal, so that sd K = K^2 sd k has one factor for all) the best middle angle moves
down, and 35 deg is within 1 % of it.

{table(head, rows)}

![trace against the middle angle, alike and weighted](images/paper-weighted.svg)

All of this takes q2 as the angle b of (22). On the M-900iB b = 90 deg - q2, lc = 0.235 m, l2 = 1.12 m. There 0, 35 and
120 deg have so many times the best value, step two weighted, all three angles free:

{table(["criterion", "best q2, deg", "0, 35, 120 over the best"], best)}"""


def table_5(designed: Designed) -> str:
    """Section on Table 5 against the designed plan."""
    with_q6 = {q6: table5.table_5(q6) for q6 in (35.0, 45.0, 135.0)}
    kept = np.delete(with_q6[135.0], [10, 11], axis=0)
    columns = [*with_q6.values(), kept, designed.plan]
    head = ["", *(f"Table 5, q6 = {q6:g}" for q6 in with_q6), "without rows 11, 12", "our plan", "variance, ours / 135"]
    shares = [table5.sd_share(c) for c in columns]
    rows = [
        [f"sd of joint {k + 2}", *(f"{100 * s[k]:.2f} %" for s in shares), f"{(shares[-1][k] / shares[2][k]) ** 2:.2f}"]
        for k in range(5)
    ]
    for name in paper.CRITERIA_NAMES:
        v = [table5.criterion(name, c) for c in columns]
        rows.append([f"{name}, 1e-4", *(f"{1e4 * x:.2f}" for x in v), f"{v[-1] / v[2]:.2f}"])
    rows.append(["poses", *(str(len(c)) for c in columns), ""])
    limits = [
        [name, ", ".join(map(str, which)), "none" if name not in table5.broken(designed.plan) else "some"]
        for name, which in table5.broken(with_q6[135.0]).items()
    ]
    said = {
        "axis1_distance_min": "wrist centre at least 1 m from axis 1",
        "transmission angle": "parallelogram at least 15 deg from flat",
        "z_min": "wrist centre at least 0.5 m high",
    }
    limits = [[said.get(name, name), which, ours] for name, which, ours in limits]
    twins = " and ".join(f"{i} and {j}" for i, j in table5.twins(with_q6[135.0]))
    one = ", ".join(f"{100 * table5.joint_4_share(q6):.0f} % with q6 = {q6:g}" for q6 in with_q6)
    return f"""## Table 5: the twelve poses, and twelve designed ones

The M-900iB of `examples/m900ib` with assumed compliances, 4 kN straight down, three reflectors, 0.03 mm; the
compliances of joints 2 to 6, sd as a share of nominal. Our plan: D-optimal, {POSES} poses out of {CANDIDATES}
candidates, the paper's limits kept (wrist centre at least 0.5 m high and 1 m from axis 1).

{table(head, rows)}

Rows {twins} are the same flange pose with the wrist flipped (placements equal to 1e-12) and tell the same: ten distinct
poses. Row 2 is printed with q6 = 35, where 45 or 135 must be meant; the columns show all three, and no gain over a
misprint is claimed. With a single reflector and 2.5 kN the sd of joint 4 is {one} of nominal.

{table(["limit", "rows of Table 5 that break it", "of our plan"], limits)}

Our plan in pendant angles (J2 = 90 deg - q2, J3 = q3):

{pose_table("plan", designed.plan)}"""


def section_5_1(designed: Designed) -> str:
    """Section on joint 1 and the side pull."""
    far = table5.largest_reach()
    alone, among = designed.side, designed.side_among_unknown
    sd = (table5.sd_share(alone, table5.side_pull(False))[0], table5.told_of_joint_1(among)[0] ** -0.5)
    rows = [
        [
            name,
            f"{table5.reach(poses)[0]:.2f}",
            f"{table5.reach(poses)[0] / far:.0%}",
            f"{table5.lever(poses)[0]:.2f}",
            f"{table5.wrist_angle(poses, table5.SIDE_PULL[:3])[0]:.0f}",
            ", ".join(f"{abs(torque):.0f}" for torque in table5.wrist_torques(poses)[0]),
            f"{share:.2%}",
        ]
        for name, poses, share in zip(("known", "unknown"), (alone, among), sd, strict=True)
    ]
    head = [
        "the other compliances",
        "reach, m",
        "of the largest",
        "lever of the pull, m",
        "axis 6 to the force, deg",
        "torques of joints 4, 5, 6, N m",
        "sd of joint 1",
    ]
    return f"""## Section 5.1: a side pull for joint 1

What the twelve poses under their vertical load say of all six joints: *{table5.unseen_under_weight()}*. The paper pulls
sideways, the arm stretched and the wrist along the force. That rule comes out by itself: one pose, 1.5 kN along the
base's y axis, joint 1 to be found, nothing said about the arm:

{table(head, rows)}

The largest horizontal reach of the load point that the limits allow is {far:.2f} m; stretching further would
flatten the parallelogram. First row: the other compliances are known, and the solver (D, {CANDIDATES} candidates)
stretches arm and wrist across the force. Second row: all other compliances are unknown, and the best pose, found by
random search for the least sd that is left, turns the wrist along the force at the price of some reach. The force then
hardly loads joints 4 and 6; joint 5 it does, because the load point lies 0.2 m beside axis 6. Of random poses half have
axis 6 more than 60 deg off the force.

{pose_table("side", alone)}

{pose_table("side among unknown", among)}"""


HEAD = """# The source paper's tables, printed and computed

`python docs/make_paper.py` writes this page from the library; `tests/docs/test_paper_tables.py` holds its numbers.
What is printed comes from our notes on the paper; a dash stands where these do not hold a printed value. The equations
and the errors in print are on [the paper's page](paper.md).

Tables 1 and 2 are about step two of the two-step method: K2, Kc and s0 Kc from joint 2's aggregated stiffness at
several q2, by the rows of (22), which
`qsframework.information.two_step.stiffness_rows` makes. lc = 0.4722 m and l2 = 0.8609 m are fitted to Table 2, because
the paper prints neither. Tables 3 and 4 are about step one."""


def page(designed: Designed) -> str:
    """The whole page, with these designed poses."""
    curves = {name: paper.curve(name) for name in paper.CRITERIA_NAMES}
    weighted = {name: paper.curve(name, paper.step_one) for name in paper.CRITERIA_NAMES}
    parts = [
        HEAD,
        tables_1_and_2(curves),
        figures(),
        tables_3_and_4(),
        thirty_five(curves, weighted),
        table_5(designed),
        section_5_1(designed),
    ]
    return "\n\n".join(map(wrapped, "\n\n".join(parts).split("\n\n"))) + "\n"


def wrapped(block: str) -> str:
    """A paragraph in lines of at most 118 characters; tables, headings and pictures as they are."""
    if block.startswith(("|", "#", "<", "!")):
        return block
    return textwrap.fill(block, 118, break_long_words=False, break_on_hyphens=False)


def pictures() -> dict[str, str]:
    """The SVG files by name."""
    q2 = "middle angle q2, deg"
    losses = plots.Axes("", q2, "loss, %", TICKS, (0, 20, 40, 60, 80, 100))
    out: dict[str, str] = {}
    for name in paper.CRITERIA_NAMES:
        values = paper.curve(name)
        loss = 100.0 * (values / values.min() - 1.0)
        bands = [plots.Band("", 100 * x - 2.0, *paper.table_2(values, x)) for x in LOSSES]
        known = [x for x in LOSSES if (name, x) in paper.RANGES]
        bands += [plots.Band(f"{x:.0%}", 100 * x + 2.0, *paper.RANGES[name, x], colour=1) for x in known]
        axes = plots.Axes(f"{TITLES[name]}: loss against the middle angle", *_rest(losses))
        out[f"paper-{name}.svg"] = plots.draw(axes, [plots.Line(name, paper.MIDDLE, loss)], bands)
    angle = np.arange(1.0, 89.01, 0.5)
    sds = np.array([paper.table_3(a) for a in angle])
    names = ("k2(0)", "k2(middle)", "k2(120)", "k3(-30)", "k3(30)")
    axes = plots.Axes(
        "sd of the aggregated compliances, sigma / F = 1 um/N",
        q2,
        "sd, urad/(N m)",
        tuple(range(0, 91, 15)),
        (0, 1, 2, 3, 4),
        names_left=True,
    )
    out["paper-sd.svg"] = plots.draw(axes, [plots.Line(n, angle, sds[:, k]) for k, n in enumerate(names)])
    alike, weighted = paper.curve("A"), paper.curve("A", paper.step_one)
    axes = plots.Axes("Trace (A): every stiffness alike, or weighted by step one", *_rest(losses))
    lines = [
        plots.Line(n, paper.MIDDLE, 100.0 * (v / v.min() - 1.0))
        for n, v in (("alike", alike), ("weighted by step one", weighted))
    ]
    out["paper-weighted.svg"] = plots.draw(axes, lines)
    return out


def _rest(axes: plots.Axes) -> tuple[str, str, Sequence[float], Sequence[float]]:
    return axes.x_name, axes.y_name, axes.x_ticks, axes.y_ticks


def main() -> None:
    """Write the page and its pictures; with --keep the designed poses of the page stay."""
    designed = read_designed(PAGE.read_text()) if "--keep" in sys.argv[1:] else solve()
    PAGE.write_text(page(designed))
    IMAGES.mkdir(exist_ok=True)
    for name, text in pictures().items():
        (IMAGES / name).write_text(text)


if __name__ == "__main__":
    main()
