"""Wrong inputs from end to end: which verb names them, and what a correction then does.

    python benchmarks/wrong_inputs.py [--parts kg,sign] [--clean 200] [--write]

Campaigns of the second generator (`independent.py`), which imports nothing of the package, are written to files, and
one thing in the files is made wrong: a unit, a scale, an axis, a sign, a load, a marker, a tool, a copy, a value of the
robot. `qsf check`, `identify` and `compensate` see the files alone; docs/results.md holds the table. What a correction
is worth is measured at fresh readings of the right arm: it is harmful where its error there is more than three times
the one that was stated, or larger than without it. `--clean`: so many campaigns without a mistake, of five noises.
"""

from __future__ import annotations

import argparse
import csv
import re
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

import numpy as np
from common import machine, replace_between, shelved, table
from independent import NOISES, Campaign, noisy, write_campaign
from independent_arm import ARMS, Hidden
from independent_effects import campaign_for

from qsframework.errors import NotConverged, QsfError
from qsframework.estimation import rms
from qsframework.experiment import Experiment, Readings, load_experiment, make_rows, read_readings
from qsframework.fits import Fit, identify
from qsframework.plans.constraints import singularity_margin
from qsframework.robot.kinematics import joint_frames
from qsframework.uses.compensate import compensate
from qsframework.uses.targets import joint_targets

PAGE = Path(__file__).resolve().parent.parent / "docs" / "results.md"
HARM = 3.0
"""Times the stated error beyond which a correction is harmful."""
BASES = (("displacements", "coiled"), ("positions", "small"), ("mixed", "loop"))
"""Kinds of readings, and arms of the second generator."""
FRESH = 1_000_003
SINGULAR = 0.03
"""`singularity_margin` below which no small correction reaches a target."""
Row = dict[str, str]
Change = Callable[[list[Row]], list[Row]]
FORCES, MOVES, PLACES = ("fx_N", "fy_N", "fz_N"), ("dx_mm", "dy_mm", "dz_mm"), ("x_mm", "y_mm", "z_mm")


def rows(change: Change) -> Callable[[Path], None]:
    """Change the rows of every table of readings."""

    def apply(folder: Path) -> None:
        for path in sorted(folder.glob("*.csv")):
            with path.open(newline="") as file:
                before = list(csv.DictReader(file))
            after = change([dict(row) for row in before])
            with path.open("w", newline="") as file:
                writer = csv.DictWriter(file, list(before[0]))
                writer.writeheader()
                writer.writerows(after)

    return apply


def cells(
    names: Sequence[str], change: Callable[[float], float], which: Callable[[int], bool] = lambda _: True
) -> Change:
    """Change the numbers of some columns; which: in the rows of these poses, by their number in the table."""

    def apply(table: list[Row]) -> list[Row]:
        order = {pose: k for k, pose in enumerate(dict.fromkeys(row["pose"] for row in table))}
        for row in table:
            for name in names:
                if name in row and which(order[row["pose"]]):
                    row[name] = repr(change(float(row[name])))
        return table

    return apply


def scaled(
    names: Sequence[str], factor: float, which: Callable[[int], bool] = lambda _: True
) -> Callable[[Path], None]:
    return rows(cells(names, lambda v: v * factor, which))


def exchanged(one: str, other: str) -> Callable[[Path], None]:
    """Two columns for each other."""

    def apply(table: list[Row]) -> list[Row]:
        for row in table:
            if one in row and other in row:
                row[one], row[other] = row[other], row[one]
        return table

    return rows(apply)


def renamed(names: dict[str, str]) -> Callable[[Path], None]:
    """Other names of markers."""

    def apply(table: list[Row]) -> list[Row]:
        for row in table:
            row["marker"] = names.get(row["marker"], row["marker"])
        return table

    return rows(apply)


def text(name: str, *pairs: tuple[str, str]) -> Callable[[Path], None]:
    """Other words in a file of the campaign or its robot."""

    def apply(folder: Path) -> None:
        path = folder / name
        said = path.read_text()
        for old, new in pairs:
            if old not in said:
                raise LookupError(f"{name} has no {old}")
            said = said.replace(old, new)
        path.write_text(said)

    return apply


def numbers(name: str, key: str, factor: float) -> Callable[[Path], None]:
    """The numbers behind keys of a YAML file that end so times a factor, wherever they stand."""
    number = re.compile(rf"({re.escape(key)}: )([-+.\de]+)")

    def apply(folder: Path) -> None:
        path = folder / name
        said, found = number.subn(lambda m: f"{m[1]}{float(m[2]) * factor:.6g}", path.read_text())
        if not found:
            raise LookupError(f"{name} has no {key}")
        path.write_text(said)

    return apply


def repeated(times: int) -> Callable[[Path], None]:
    """Every row again under the name of another pose."""

    def apply(table: list[Row]) -> list[Row]:
        again = [{**row, "pose": f"{row['pose']}_{k}"} for k in range(times) for row in table]
        return [*table, *again]

    return rows(apply)


def frozen_pose(count: int) -> Callable[[Path], None]:
    """The readings of the first pose at the next ones too."""

    def apply(table: list[Row]) -> list[Row]:
        poses = list(dict.fromkeys(row["pose"] for row in table))
        values = MOVES if MOVES[0] in table[0] else PLACES
        first = {(row["marker"], row.get("state")): row for row in table if row["pose"] == poses[0]}
        for row in table:
            source = first.get((row["marker"], row.get("state")))
            if row["pose"] in poses[1 : count + 1] and source is not None:
                row.update({name: source[name] for name in values})
        return table

    return rows(apply)


def angle(
    joint: int, change: Callable[[float], float], which: Callable[[int], bool] = lambda _: True
) -> Callable[[Path], None]:
    return rows(cells((f"q{joint}_deg",), change, which))


def coupled(table: list[Row]) -> list[Row]:
    """The third angle as controllers with a coupled elbow show it."""
    for row in table:
        row["q3_deg"] = repr(float(row["q3_deg"]) + float(row["q2_deg"]))
    return table


def turned(table: list[Row]) -> list[Row]:
    """Readings on axes that are turned by 90 degrees about the vertical."""
    x, y = (MOVES if MOVES[0] in table[0] else PLACES)[:2]
    for row in table:
        row[x], row[y] = row[y], repr(-float(row[x]))
    return table


def late(table: list[Row]) -> list[Row]:
    """The angles of the pose before, from the middle on."""
    poses = list(dict.fromkeys(row["pose"] for row in table))
    angles = {row["pose"]: {k: v for k, v in row.items() if k.startswith("q")} for row in table}
    for row in table:
        k = poses.index(row["pose"])
        if k > len(poses) // 2:
            row.update(angles[poses[k - 1]])
    return table


def half(k: int) -> bool:
    return k % 2 == 0


def few(k: int) -> bool:
    return k in (2, 7, 11)


def later(k: int) -> bool:
    return k >= 8


VALUES = (*MOVES, *PLACES)
KINDS: dict[str, Callable[[Path], None]] = {
    "loads in kg": scaled(FORCES, 1 / 9.80665),
    "loads in lbf": scaled(FORCES, 1 / 4.4482216),
    "loads in kN": scaled(FORCES, 1e-3),
    "loads in tenths": scaled(FORCES, 0.1),
    "loads half as large": scaled(FORCES, 0.5),
    "half of the weight on half of the poses": scaled(FORCES, 0.5, half),
    "a load of three poses in kg": scaled(FORCES, 1 / 9.80665, few),
    "loads in kg from the eighth pose on": scaled(FORCES, 1 / 9.80665, later),
    "loads upward": scaled(FORCES, -1.0),
    "fy for fz": exchanged("fy_N", "fz_N"),
    "fx for fz": exchanged("fx_N", "fz_N"),
    "readings in m": scaled(VALUES, 1e-3),
    "readings in um": scaled(VALUES, 1e3),
    "readings in inches": scaled(VALUES, 1 / 25.4),
    "readings in cm": scaled(VALUES, 0.1),
    "readings doubled": scaled(VALUES, 2.0),
    "readings doubled at half of the poses": scaled(VALUES, 2.0, half),
    "readings in inches at three poses": scaled(VALUES, 1 / 25.4, few),
    "readings of the other sign": scaled(VALUES, -1.0),
    "z of the other sign": scaled(("dz_mm", "z_mm"), -1.0),
    "x of the other sign": scaled(("dx_mm", "x_mm"), -1.0),
    "y and z of the readings exchanged": exchanged("dy_mm", "dz_mm"),
    "readings on turned axes": rows(turned),
    "sign of angle 1": angle(1, lambda v: -v),
    "sign of angle 2": angle(2, lambda v: -v),
    "sign of angle 4": angle(4, lambda v: -v),
    "sign of angle 6": angle(6, lambda v: -v),
    "angle 3 with angle 2 added": rows(coupled),
    "angle 5 off by 2 degrees": angle(5, lambda v: v + 2.0),
    "angle 2 off by 2 degrees at three poses": angle(2, lambda v: v + 2.0, few),
    "angle 5 in radians": angle(5, lambda v: v / 57.29577951308232),
    "angles 4 and 6 exchanged": exchanged("q4_deg", "q6_deg"),
    "angles of the pose before": rows(late),
    "markers exchanged": renamed({"m1": "m2", "m2": "m1"}),
    "markers in a ring": renamed({"m1": "m2", "m2": "m3", "m3": "m1"}),
    "every row again": repeated(1),
    "every row three times more": repeated(3),
    "the first pose's readings at five more": frozen_pose(5),
    "marker 100 mm off": text("experiment.yaml", ("250.0, 200.0", "250.0, 300.0")),
    "tool turned": text(
        "experiment.yaml",
        ("[250.0, 200.0, -100.0]", "[200.0, -250.0, -100.0]"),
        ("[50.0, -200.0, 300.0]", "[-200.0, -50.0, 300.0]"),
        ("[300.0, -100.0, 200.0]", "[-100.0, -300.0, 200.0]"),
    ),
    "load point 300 mm off": text("experiment.yaml", ("point_mm: [150.0, 0.0", "point_mm: [150.0, 300.0")),
    "load point in m": text("experiment.yaml", ("point_mm: [150.0, 0.0, 200.0]", "point_mm: [0.15, 0.0, 0.2]")),
    "noise in m": numbers("experiment.yaml", "sigma_mm", 1e-3),
    "noise in um": numbers("experiment.yaml", "sigma_mm", 1e3),
    "noise ten times too large": numbers("experiment.yaml", "sigma_mm", 10.0),
    "noise ten times too small": numbers("experiment.yaml", "sigma_mm", 0.1),
    "compliances in nrad for urad": numbers("robot/nominal.yaml", "value_urad/(N m)", 1e3),
    "balancer a thousand times too soft": numbers("robot/nominal.yaml", "value_N/m", 1e-3),
    "balancer ten times too stiff": numbers("robot/nominal.yaml", "value_N/m", 10.0),
}


@dataclass(frozen=True)
class Outcome:
    """What became of one input. check, identify: the names of what they say; stops: whether one of them stops
    what uses the fit; stop: what compensate says instead of a correction; masked: whether the fit left rows out; errors
    m at fresh readings: stated, real, of the arm before."""

    kind: str
    base: str
    refused: str = ""
    check: tuple[str, ...] = ()
    identify: tuple[str, ...] = ()
    stops: bool = False
    stop: str = ""
    masked: bool = False
    stated: float = np.nan
    real: float = np.nan
    before: float = np.nan

    @property
    def sizes(self) -> tuple[float, float, float]:
        """Before, stated and real."""
        return self.before, self.stated, self.real

    @property
    def why(self) -> str:
        """What names it."""
        return ", ".join(self.identify) or self.refused or self.stop

    @property
    def used(self) -> bool:
        return not (self.refused or self.stop)

    @property
    def harmful(self) -> bool:
        return self.used and (self.real > HARM * self.stated or self.real > 1.05 * self.before)

    @property
    def verdict(self) -> str:
        if self.refused:
            return "refused"
        if self.stop:
            return "named, stopped" if self.identify else "stopped"
        if self.check or self.stops:
            return "named, left out" if self.masked and not self.harmful else "named, used"
        return "unnoticed, harmful" if self.harmful else "harmless"


def campaign_of(kind: str, arm: str, seed: int, noise: str = "nominal", poses: int = 24) -> Campaign:
    return Campaign(campaign_for(kind, ARMS[arm], poses, seed, noise))


def outcome(kind: str, change: Callable[[Path], None] | None, campaign: Campaign, base: str) -> Outcome:
    """What the verbs say and do of one campaign with one thing made wrong."""
    found = Outcome(kind, base)
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as other:
        folder = write_campaign(campaign, noisy(campaign, campaign.clean(Hidden())), Path(one)).parent
        if change is not None:
            change(folder)
        try:
            experiment = load_experiment(folder / "experiment.yaml")
            readings = read_readings(experiment.data, experiment, "positions")
            fit = identify(experiment, readings)
        except QsfError as error:
            return replace(found, refused=str(error).splitlines()[0].partition(": ")[2][:90])
        findings = fit.account.findings
        named = tuple(dict.fromkeys(f.name.partition("[")[0] for f in findings))
        found = replace(found, identify=named, stops=any(f.stops for f in findings))
        found = replace(found, check=checked(experiment, readings), masked=bool(fit.masked))
        fresh = Campaign(replace(campaign.setting, poses=40, seed=campaign.setting.seed + FRESH, noise="nominal"))
        right = load_experiment(write_campaign(fresh, fresh.clean(Hidden(), campaign.built), Path(other)))
        at = read_readings(right.data, right, "positions")
        try:
            stated = stated_error(experiment, fit, at)
        except QsfError as error:
            return replace(found, stop=str(error).splitlines()[0].partition(": ")[2][:90])
        try:
            real, before = real_errors(right, fit, at)
        except NotConverged:  # the fitted arm does not bear the load
            real, before = np.inf, np.nan
    return replace(found, stated=stated, real=real, before=before)


def checked(experiment: Experiment, readings: Readings) -> tuple[str, ...]:
    """What `qsf check` marks."""
    from qsframework.cli.check import experiment_lines

    return tuple(kind for good, kind, _ in experiment_lines(experiment, readings) if good is False)


def stated_error(experiment: Experiment, fit: Fit, at: Readings) -> float:
    """RMS, m, of the errors that a correction of the loaded poses of fresh readings states; singular ones left out."""
    regular = singularity_margin(experiment.robot, joint_frames(experiment.robot.facts, at.poses.q)) > SINGULAR
    loaded = np.flatnonzero(np.any(at.poses.wrench, axis=1) & regular)
    targets = joint_targets(experiment, at.poses.pendant[loaded], at.poses.wrench[loaded])
    reference = "commanded" if fit.account.positions else "unloaded"
    return float(np.sqrt(np.mean(np.square(compensate(experiment, fit, targets, reference).sd))))


def real_errors(right: Experiment, fit: Fit, at: Readings) -> tuple[float, float]:
    """3D RMS, m, at fresh readings: of the fit in the frames of the right campaign, and of the arm before."""
    rows = make_rows(at)
    model = right.model()
    x = np.array([fit.model_values.get(p.name, p.nominal) for p in model.parameters])
    nominal = np.array([p.nominal for p in model.parameters])
    after, before = (rms(rows.measured - rows.predict(model, v, rows.start(model, v))) for v in (x, nominal))
    return float(np.sqrt(3.0) * after), float(np.sqrt(3.0) * before)


def clean(number: int) -> Outcome:
    """What is said of a campaign without a mistake."""
    kind, arm = BASES[number % len(BASES)]
    noise = NOISES[number % len(NOISES)]
    return outcome(
        "clean", None, campaign_of(kind, arm, 500 + number, noise, (14, 24, 40)[number % 3]), f"{kind}, {noise}"
    )


def mm(value: float) -> str:
    return f"{1e3 * value:.3f}" if np.isfinite(value) else ""


def tables(found: Sequence[Outcome], plain: Sequence[Outcome]) -> str:
    """The goals, and each input."""
    counts = Counter(one.verdict for one in found)
    goals = [
        ("named by one verb and used by another without a stop", "0", str(counts["named, used"])),
        ("harmful and unnoticed", "-", str(counts["unnoticed, harmful"])),
        ("refused by the reader or by the fit", "-", str(counts["refused"])),
        ("named, and whatever uses the fit stops", "-", str(counts["named, stopped"] + counts["stopped"])),
        ("named, and its rows left out by the fit", "-", str(counts["named, left out"])),
        ("harmless: no correction worse than stated", "-", str(counts["harmless"])),
    ]
    rows = [(words, goal, hits, str(len(found))) for words, goal, hits in goals]
    if plain:
        wrong = sum(bool(one.stops or one.refused) for one in plain)
        rows.append(("clean campaigns in which something is stopped", "<= 1 %", str(wrong), str(len(plain))))
    each = [(one.kind, one.base, one.verdict, one.why, *map(mm, one.sizes)) for one in found]
    head = ("wrong input", "readings, arm", "outcome", "what names it", "before, mm", "stated, mm", "real, mm")
    return f"{table(('what becomes of them', 'goal', 'inputs', 'of'), rows)}\n\n{table(head, each)}"


def main() -> None:
    """Run, print, and write where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--parts", default="", help="parts of the names of kinds, comma between")
    parser.add_argument("--clean", type=int, default=0, help="campaigns without a mistake")
    parser.add_argument("--write", action="store_true", help="write the tables to docs/results.md")
    given = parser.parse_args()
    parts = [p for p in given.parts.split(",") if p]
    found: list[Outcome] = []
    for name, change in KINDS.items():
        if parts and not any(p in name for p in parts):
            continue
        for seed, (kind, arm) in enumerate(BASES):
            try:
                one = outcome(name, change, campaign_of(kind, arm, 40 + seed), f"{kind}, {arm}")
            except LookupError:
                continue  # this campaign has no such file, key or column
            found.append(one)
            print(
                f"{one.kind:42s} {one.base:22s} {one.verdict:18s}", one.check, one.why, *map(mm, one.sizes), flush=True
            )
    plain = [clean(k) for k in range(given.clean)]
    for one in plain:
        if one.stop or one.identify or one.refused or one.harmful:
            print("clean:", one)
    said = tables(found, plain)
    print(said)
    if given.write:
        head = f"`python benchmarks/wrong_inputs.py --clean {given.clean}`; {date.today().isoformat()}; {machine()}."
        record = f"{head}\n\n{shelved(said, 'wrong inputs')}"
        replace_between(PAGE, "<!-- wrong inputs -->", "<!-- end of wrong inputs -->", record)


if __name__ == "__main__":
    main()
