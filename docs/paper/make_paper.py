"""Write paper-tables.md, the source paper's tables, printed and computed: python docs/paper/make_paper.py

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
import paper_wrist as wrist

from qsframework.design import design
from qsframework.plugin import Array

HERE = Path(__file__).resolve().parents[1]
PAGE = HERE / "paper-tables.md"
IMAGES = HERE / "images"
POSES, CANDIDATES, SEED = 12, 1000, 0
LOSSES = (0.1, 0.2, 0.5)
TITLES = {"A": "O1, the trace (A)", "D": "O2, the determinant's cube root (D)", "O3": "O3, half their sum"}
TICKS = tuple(range(0, 121, 20))
MIDDLE_NAME = "middle angle q2, deg"


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


def span(ends: tuple[float, float], digits: int = 0) -> str:
    return f"{ends[0]:.{digits}f} to {ends[1]:.{digits}f}"


def table_1() -> str:
    """Section on Table 1."""
    one = paper.table_1()
    head = ["measurements", *(f"{c} {w}" for c in ("O1", "O2", "O3") for w in ("printed", "computed"))]
    values, per, angles = [], [], []
    for k, count in enumerate(paper.COUNTS):
        value, each = [str(count)], [str(count)]
        for name in paper.CRITERIA_NAMES:
            value += [f"{paper.TABLE_1[name][k]:.2f}", f"{one.value[name][k]:.2f}"]
            each += [paper.PER_CONFIGURATION[name][k], f"{count * one.value[name][k]:.2f}"]
        values.append(value)
        per.append(each)
        angles.append([str(count), *(degrees(one.angles[name][k]) for name in paper.CRITERIA_NAMES)])
    ours = ", ".join(f"{paper.curve(name).min():.2f}" for name in ("A", "D"))
    return f"""## Table 1: how many angles, and which

All angles are free between 0 and 120 deg. O1 is the trace (A), O2 the cube root of the determinant (D), O3 half their
sum. The paper does not print its units: with unit noise our three measurements come to {ours} for O1 and O2, and one
factor for each brings these to the printed 14.27 and 2.11. All other cells follow.

{table(head, values)}

The value per configuration, which is the criterion times the number of measurements:

{table(head, per)}

The best angles, deg. With four and five measurements the best three repeat, as the paper says; it gives the middle
angle as 47.1 to 50.0 deg.

{table(["measurements", "O1", "O2", "O3"], angles)}

The ratios and angles of O1 and O2 do not depend on the units, those of O3 by less than 1 deg. O2 depends on lc / l2
only; O1's best angle moves by 1 to 3 deg if both lengths are halved or doubled."""


def table_2() -> str:
    """Section on Table 2."""
    curves = {name: paper.paper_curve(name) for name in paper.CRITERIA_NAMES}
    first = ["min"]
    for name, values in curves.items():
        angle, value = paper.TABLE_2_BEST[name]
        first += [f"{angle} ({value})", f"{paper.best_middle(values):.1f} ({values.min():.2f})"]
    rows = [first]
    for k, loss in enumerate(LOSSES):
        row = [f"{loss:.0%}"]
        for name, values in curves.items():
            printed = paper.O3_RANGES[loss] if name == "O3" else paper.RANGES[name, loss]
            row.append(f"{span(printed)} ({paper.TABLE_2_VALUE[name][k]})")
            row.append(f"{span(paper.table_2(values, loss), 1)} ({(1.0 + loss) * values.min():.2f})")
        rows.append(row)
    best, twice = paper.BEST_VALUE["O3"], span(paper.table_2(curves["O3"], 1.0), 1)
    head = ["loss", *(f"{c} {w}" for c in ("O1", "O2", "O3") for w in ("printed", "computed"))]
    return f"""## Table 2: how far the middle angle may be off

Middle angles (deg) at which the criterion is at most so much above its best, and in brackets the criterion there, in
Table 1's units. The paper's columns O1 and O2 are exchanged back (see the [errors in print](paper.md#errors-in-print)).

{table(head, rows)}

The last row prints {paper.O3_LAST_ROW} for O3 at 50 %; from a best of {best} that is {paper.O3_LAST_ROW / best:.2f}
times the best, a loss of 100 %, which holds from {twice} deg. At 50 % it is {1.5 * best:.1f}."""


def figures_6_and_7() -> str:
    return """## Figure 6: where the wrist may be

Distance from axis 1 and height of the wrist centre over q2, for the forearm at q3 = -30, 0 and 30 deg; the bar is the
limit of the paper's experiment, 1 m and 0.5 m. With q3 from -30 to 30 deg the wrist stays above 0.5 m from q2 = 0 on:
there it is at 0.514 m. Towards 120 deg it comes too near to axis 1: below 1 m from q2 = 111 deg on with q3 = 30, while
q3 = -30 keeps 1.09 m at 120 deg. So the paper's range of q2 up to 120 deg holds for the lower forearm alone.

![Distance of the wrist centre from axis 1 over q2](images/paper-6x.svg)

![Height of the wrist centre over q2](images/paper-6z.svg)

## Figure 7: the criteria against the middle angle

The loss against the best middle angle, q2 = 0 and 120 deg being the other two. Bars: the ranges of Table 2, computed
(grey) and printed (orange). The valley is flat for the determinant and steep for the trace, so the trace decides.

![O1, the trace, against the middle angle](images/paper-A.svg)

![O2, the determinant's cube root, against the middle angle](images/paper-D.svg)

![O3, half their sum, against the middle angle](images/paper-O3.svg)"""


AGGREGATED = ("q2 = 0", "q2 = 120", "q2 = middle", "q3 = -30", "q3 = 30")


def tables_3_and_4() -> str:
    """Sections on Tables 3 and 4 and Figure 8."""
    head = ["middle angle, deg", *(f"{c}, {w}" for c in AGGREGATED for w in ("printed", "computed"))]
    three = []
    for middle, printed in paper.TABLE_3:
        computed = paper.table_3(middle)[list(paper.COLUMN_ORDER)]
        three.append([f"{middle:g}", *(f"{v:.2f}" for pair in zip(printed, computed, strict=True) for v in pair)])
    best = [(paper.TABLE_4_BEST[k], paper.table_4_best(k)) for k in range(5)]
    four = [["min", *(f"{a:.{d}f} ({v:.2f})" for pair in best for d, (a, v) in enumerate(pair))]]
    for loss in LOSSES:
        row = [f"{loss:.0%}"]
        for k, (printed, value) in enumerate(paper.TABLE_4[loss]):
            row += [
                f"{span(printed)} ({value:.2f})",
                f"{span(paper.table_4(loss, k), 1)} ({(1 + loss) * best[k][1][1]:.2f})",
            ]
        four.append(row)
    return f"""## Table 3: what step one tells

The sd of five aggregated compliances, urad/(N m), from six planar poses: q2 = 0, middle, 120 deg with the forearm at
-30 and 30 deg, a vertical force, sigma / F = 1 um/N, l2 = 1.12 m, l3 = 1.285 m. The paper heads them N m/urad and calls
them variances. Its rows are the middle angles at which each column is least, in the columns' order.

{table(head, three)}

One cell cannot be: at 88 deg link 2 is nearly upright, the force has a lever of l2 |cos q2| = 0.04 m, and the sd
grows as 1 / |cos q2|. Every other printed cell is within 0.01 of the computed one.

## Table 4: how far the middle angle may be off for step one

Middle angles (deg) at which a column of Table 3 is at most so much above its least, and in brackets the value there.

{table(["loss", *head[1:]], four)}

Every printed end is within 0.7 deg of the computed one. The paper's last column, the range for the parameters (47 to
50, 38 to 57, 35 to 60, 29 to 67 deg), repeats Table 2: the angles that its three criteria, or the trace alone, allow.

## Figure 8: the aggregated compliances against the middle angle

Figure 8a shows those of joint 2, 8b those of joint 3. An upright link 2 is not seen; the curve is cut there.

![sd of joint 2's compliances against the middle angle](images/paper-8a.svg)

![sd of joint 3's compliances against the middle angle](images/paper-8b.svg)"""


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

{table_5_rows()}

{table(head, rows)}

Rows {twins} are the same flange pose with the wrist flipped (placements equal to 1e-12) and tell the same: ten distinct
poses. Row 2 is printed with q6 = 35, where 45 or 135 must be meant; the columns show all three, and no gain over a
misprint is claimed. With a single reflector and 2.5 kN the sd of joint 4 is {one} of nominal.

{table(["limit", "rows of Table 5 that break it", "of our plan"], limits)}

Our plan in pendant angles (J2 = 90 deg - q2, J3 = q3):

{pose_table("plan", designed.plan)}"""


def table_5_rows() -> str:
    """Table 5 row by row, with what the limits say of it."""
    angles = table5.table_5(35.0)
    rows = [
        [
            str(i + 1),
            *(f"{a:g}" for a in (p[0], 90.0 - p[1], *p[2:])),
            f"{at.height:.2f}",
            f"{at.distance:.2f}",
            f"{at.flat:.0f}",
        ]
        for i, (p, at) in enumerate(zip(angles, wrist.row_limits(angles), strict=True))
    ]
    head = ["row", *(f"q{k}" for k in range(1, 7)), "wrist's height, m", "from axis 1, m", "from flat, deg"]
    return f"""As printed, deg, and where the rows stand: the wrist centre's height and distance from axis 1, and how
far the parallelogram is from flat.

{table(head, rows)}"""


def section_5_3() -> str:
    """Section on the rules for the wrist against the best wrist angles."""
    plans = {
        "Table 5, row 2 with q6 = 135": table5.table_5(),
        "the same angles, best combined": wrist.by_the_rule().pendant_deg,
        "any wrist angles": wrist.free().pendant_deg,
    }
    first = table5.criterion("D", table5.table_5())
    rows = []
    for name, poses in plans.items():
        d, shares = table5.criterion("D", poses), table5.sd_share(poses)
        rows.append([name, f"{1e4 * d:.2f}", f"{d / first:.2f}", *(f"{100 * s:.2f} %" for s in shares)])
    far = np.abs(wrist.free().pendant_deg[:, 4])
    return f"""## Section 5.3: the wrist's rules against the best wrist angles

The paper says that its wrist angles agree with analytical rules of an earlier work of its authors, which it does not
repeat. What Table 5 shows of them: q4 and q6 stand half way between the axes (45 or 135 deg to either side), q5 at
30 deg to either side. Table 5's arms (q1 to q3) are kept here, and only the wrist is chosen anew: from the angles that
the table uses, and from all of a grid of 15 deg inside joint 5's limits, D-optimal by exchange.

{table(["wrist", "D, 1e-4", "over Table 5's", *(f"joint {k}" for k in range(2, 7))], rows)}

With the table's own angles in another combination D is half as large, and joint 4 is told five times better: the rules
name good angles, not how they belong together. A free wrist gains another quarter. It bends joint 5 by
{far.min():.0f} to {far.max():.0f} deg, {(far >= 75).sum()} of 12 times by 75 or more, because the weight's lever about
axes 4 and 6 grows with the bend: 30 deg is a good angle for joint 5, not the best one for joint 4. The rules are those
of a planar arm, whose wrist bends in one plane."""


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

`python docs/paper/make_paper.py` writes this page from the library; `tests/docs/test_paper_tables.py` holds its
numbers. Every printed cell of Tables 1 to 5 stands beside the computed one, and Figures 6 to 8 are drawn anew. The
equations and the errors in print are on [the paper's page](paper.md); the same way on the shipped robot, from base to
wrist, is an example, `examples/m900ib/paper.md`.

Tables 1 and 2 are about step two of the two-step method: K2, Kc and s0 Kc from joint 2's aggregated stiffness at
several q2, by the rows of (22), which
`paper_steps.stiffness_rows` makes. lc = 0.4722 m and l2 = 0.8609 m are fitted to Table 2, because
the paper prints neither. Tables 3 and 4 are about step one."""


def page(designed: Designed) -> str:
    """The whole page, with these designed poses."""
    curves = {name: paper.curve(name) for name in paper.CRITERIA_NAMES}
    weighted = {name: paper.curve(name, paper.step_one) for name in paper.CRITERIA_NAMES}
    parts = [
        HEAD,
        table_1(),
        table_2(),
        figures_6_and_7(),
        tables_3_and_4(),
        thirty_five(curves, weighted),
        table_5(designed),
        section_5_3(),
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
    losses = plots.Axes("", MIDDLE_NAME, "loss, %", TICKS, (0, 20, 40, 60, 80, 100))
    out: dict[str, str] = {}
    for name in paper.CRITERIA_NAMES:
        values = paper.paper_curve(name)
        loss = 100.0 * (values / values.min() - 1.0)
        bands = [plots.Band("", 100 * x - 2.0, *paper.table_2(values, x)) for x in LOSSES]
        printed = {x: paper.O3_RANGES[x] if name == "O3" else paper.RANGES[name, x] for x in LOSSES}
        bands += [plots.Band(f"{x:.0%}", 100 * x + 2.0, *ends, colour=1) for x, ends in printed.items()]
        axes = plots.Axes(f"{TITLES[name]}: loss against the middle angle", *_rest(losses))
        out[f"paper-{name}.svg"] = plots.draw(axes, [plots.Line(name, paper.MIDDLE, loss)], bands)
    alike, weighted = paper.curve("A"), paper.curve("A", paper.step_one)
    axes = plots.Axes("Trace (A): every stiffness alike, or weighted by step one", *_rest(losses))
    lines = [
        plots.Line(n, paper.MIDDLE, 100.0 * (v / v.min() - 1.0))
        for n, v in (("alike", alike), ("weighted by step one", weighted))
    ]
    out["paper-weighted.svg"] = plots.draw(axes, lines)
    return out | figure_6() | figure_8()


def figure_6() -> dict[str, str]:
    """Distance from axis 1 and height of the wrist centre over q2, with the limits of the experiment."""
    q2 = np.arange(0.0, 120.01, 1.0)
    at = {q3: wrist.wrist_centre(np.deg2rad(q2), np.deg2rad(q3)) for q3 in (-30.0, 0.0, 30.0)}
    limit = {"x": ("distance from axis 1, m", wrist.AXIS_1_MIN), "z": ("height, m", wrist.Z_MIN)}
    out = {}
    for k, (letter, (words, least)) in enumerate(limit.items()):
        axes = plots.Axes(f"Wrist centre over link 2's elevation: {words}", "q2, deg", words, TICKS, (0, 1, 2, 3))
        lines = [plots.Line(f"q3 = {q3:g} deg", q2, both[k]) for q3, both in at.items()]
        out[f"paper-6{letter}.svg"] = plots.draw(axes, lines, [plots.Band("", least, 0.0, 120.0)])
    return out


def figure_8() -> dict[str, str]:
    """sd of the aggregated compliances of joint 2 (a) and joint 3 (b) over the middle angle."""
    angle, sd = paper.TABLE_4_ANGLES, paper.table_3_curves()
    parts = {"a": (range(3), (0, 1, 2, 3, 4)), "b": (range(3, 5), (0.4, 0.45, 0.5, 0.55, 0.6))}
    out = {}
    for letter, (columns, ticks) in parts.items():
        joint = 2 if letter == "a" else 3
        title = f"sd of joint {joint}'s aggregated compliances, sigma / F = 1 um/N"
        axes = plots.Axes(title, MIDDLE_NAME, "sd, urad/(N m)", TICKS, ticks, names_left=letter == "a")
        lines = [plots.Line(AGGREGATED[k], angle, sd[:, k]) for k in columns]
        out[f"paper-8{letter}.svg"] = plots.draw(axes, lines)
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
