"""The source paper's tables, printed and computed: python docs/paper/make_paper.py

Writes the second half of docs/paper.md, its pictures, and every table as docs/records/paper-*.csv. The designed poses
are the only thing here that takes a solver; they are read back from their tables (`--keep`), so that everything else
can be made anew in a second.
"""

from __future__ import annotations

import csv
import io
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

from qsframework.plans import design
from qsframework.plugin import Array

HERE = Path(__file__).resolve().parents[1]
PAGE = HERE / "paper.md"
RECORDS = HERE / "records"
START, STOP = "<!-- tables -->\n", "<!-- end of tables -->\n"
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


def read_designed() -> Designed:
    """The designed poses that stand in their tables."""

    def poses(name: str) -> Array:
        with (RECORDS / f"paper-{name}.csv").open() as lines:
            return np.array([[float(v) for v in row[1:]] for row in list(csv.reader(lines))[1:]])

    return Designed(poses("plan"), poses("side"), poses("side-among-unknown"))


def table(name: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table that `parted` makes a file of, and a link to it."""
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([header, *rows])
    return f"<table {name}>{out.getvalue()}</table>"


def parted(text: str) -> tuple[str, dict[str, str]]:
    """The text with links in place of its tables, and these by the names of their files."""
    found = re.findall(r"<table (.*?)>(.*?)</table>", text, re.S)
    linked = re.sub(r"<table (.*?)>.*?</table>", r"[\1](records/paper-\1.csv)", text, flags=re.S)
    return linked, {f"paper-{name}.csv": rows for name, rows in found}


def pose_table(name: str, pendant_deg: Array) -> str:
    """Pendant angles, found again by `read_designed`."""
    rows = [[str(i + 1), *(f"{a:.2f}" for a in pose)] for i, pose in enumerate(pendant_deg)]
    return table(name, ["pose", *(f"J{k}, deg" for k in range(1, 7))], rows)


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
    return f"""### Tables 1 and 2: step two

K2, Kc and s0 Kc from joint 2's aggregated stiffness at several q2 between 0 and 120 deg, by the rows of (22). The
paper does not print its units: with unit noise three measurements come to {ours} for O1 and O2, and one factor for
each brings these to the printed 14.27 and 2.11. All other cells follow: {table("table-1", head, values)},
{table("table-1-per-configuration", head, per)},
{table("table-1-angles", ["measurements", "O1", "O2", "O3"], angles)}. With four and five measurements the best three
angles repeat."""


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
    head = ["loss", *(f"{c} {w}" for c in ("O1", "O2", "O3") for w in ("printed", "computed"))]
    return f"""How far the middle angle may be off ({table("table-2", head, rows)}; columns O1 and O2 are exchanged
back): the trace decides. Grey bars are computed ranges, orange printed ones.

![O1, the trace, against the middle angle](images/paper-A.svg)

![O2, the determinant's cube root, against the middle angle](images/paper-D.svg)

![O3, half their sum, against the middle angle](images/paper-O3.svg)"""


def figure_6_text() -> str:
    return """### Figure 6: where the wrist may be

The bar is the limit of the paper's experiment: 1 m from axis 1, 0.5 m high. With q3 = 30 the wrist comes nearer
([errors](#errors-in-print)).

![Distance of the wrist centre from axis 1 over q2](images/paper-6x.svg)

![Height of the wrist centre over q2](images/paper-6z.svg)"""


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
    return f"""### Tables 3 and 4: step one

The sd of five aggregated compliances, urad/(N m), from six planar poses under a vertical force, sigma / F = 1 um/N
({table("table-3", head, three)}); it grows as 1 / |cos q2|. How far the middle angle may be
off: {table("table-4", ["loss", *head[1:]], four)}.

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
    weighed = table("35-deg", head, rows)
    return f"""### Why 35 deg and not 47 to 50

Tables 1 and 2 weigh every aggregated stiffness alike, but step one knows k2 the worse the more upright link 2
stands. With its covariance as the weight the best middle angle of the trace moves from {rows[0][1]} to
{rows[0][2]} deg; 35 deg is within 1 % of it, 48 deg loses {rows[0][4]} ({weighed}).

![trace against the middle angle, alike and weighted](images/paper-weighted.svg)

With the M-900iB's b = 90 deg - q2 in (22), 0, 35 and 120 deg have {best[0][2]} times the best trace and {best[1][2]}
times the best determinant
({table("on-the-robot", ["criterion", "best q2, deg", "0, 35, 120 over the best"], best)})."""


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
    broken = table("limits", ["limit", "rows of Table 5 that break it", "of our plan"], limits)
    return f"""### Table 5: the twelve poses, and twelve designed ones

The M-900iB of `examples/m900ib` with assumed compliances, 4 kN straight down, three reflectors, 0.03 mm. Our plan is
D-optimal for joints 2 to 6, {POSES} poses out of {CANDIDATES} candidates within the paper's limits
({pose_table("plan", designed.plan)}). Its D is {rows[6][-1]} times that of Table 5 with q6 = 135 in row 2, its
variances {", ".join(r[-1] for r in rows[:5])} times ({table("table-5", head, rows)}). What Table 5 breaks:
[errors in print](#errors-in-print), {broken}, {table_5_rows()}."""


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
    return table("table-5-rows", head, rows)


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
    head = ["wrist", "D, 1e-4", "over Table 5's", *(f"joint {k}" for k in range(2, 7))]
    return f"""### Section 5.3: the wrist

In Table 5 q4 and q6 stand at 45 or 135 deg, q5 at 30 deg. With these angles combined anew, q1 to q3 kept, D is
{rows[1][2]} times as large; with any wrist angles {rows[2][2]} times ({table("wrist", head, rows)}). The free wrist
bends joint 5 by {far.min():.0f} to {far.max():.0f} deg: 30 deg is a good angle for joint 5, not the best one for joint
4."""


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
    return f"""### Section 5.1: a side pull for joint 1

Under the vertical load: *{table5.unseen_under_weight()}*. The paper pulls sideways, the arm stretched and the wrist
along the force. The solver finds the same for one pose under 1.5 kN along y: with the other compliances known it
reaches out {rows[0][1]} m of {far:.2f} m across the force ({pose_table("side", alone)}); with them unknown axis 6
stands {rows[1][4]} deg from the force ({pose_table("side-among-unknown", among)}). Both:
{table("side-pull", head, rows)}."""


HEAD = """## Tables and figures

Made by `python docs/paper/make_paper.py`; each link is a table of printed and computed cells.

| of the paper | computed against printed |
|---|---|
| Table 1 | every cell within 1 % |
| Table 2 | ends within 4 deg, values within 1 %, but for one error in print |
| Table 3 | every cell within 0.01, but for one error in print |
| Table 4 | ends within 0.7 deg, values within 0.01 |
| Table 5 | twelve designed poses determine every joint better and keep the limits, which four of its rows break |"""


def page(designed: Designed) -> str:
    """The half of the page, with these designed poses; its tables are inside."""
    curves = {name: paper.curve(name) for name in paper.CRITERIA_NAMES}
    weighted = {name: paper.curve(name, paper.step_one) for name in paper.CRITERIA_NAMES}
    parts = [
        HEAD,
        table_1(),
        table_2(),
        figure_6_text(),
        tables_3_and_4(),
        thirty_five(curves, weighted),
        table_5(designed),
        section_5_3(),
        section_5_1(designed),
    ]
    return "\n\n".join(parts)


def written(designed: Designed) -> tuple[str, dict[str, str]]:
    """What stands between the marks of the page, and the tables by the names of their files."""
    text, tables = parted(page(designed))
    return "\n\n".join(map(wrapped, text.split("\n\n"))) + "\n", tables


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
    """Write page, tables and pictures; with --keep the designed poses stay."""
    designed = read_designed() if "--keep" in sys.argv[1:] else solve()
    text, tables = written(designed)
    before, after = PAGE.read_text().partition(START)[0], PAGE.read_text().partition(STOP)[2]
    PAGE.write_text(f"{before}{START}{text}{STOP}{after}")
    for name, rows in tables.items():
        (RECORDS / name).write_text(rows)
    IMAGES.mkdir(exist_ok=True)
    for name, text in pictures().items():
        (IMAGES / name).write_text(text)


if __name__ == "__main__":
    main()
