"""A simulated campaign, and how the programs of trackers would export it, written after public descriptions.

Coordinates have four decimals of a millimetre, as trackers' tables do, so that every format can hold them exactly.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from qsf_controllers.export import export
from qsframework.elastostatics.so3 import exponential
from qsframework.experiment import Experiment, Frame, Plan, load_experiment, make_plan, write_plan
from qsframework.experiment.columns import joint_cells, number, write_table
from qsframework.plans.programme import draft
from qsframework.plugin import Array, Poses

EXPERIMENT = """robot: fanuc_m900ib
load: {point_mm: [150, 0, 200]}
markers:
  m1: {xyz_mm: [150, 250, 250]}
  m2: {xyz_mm: [400, -150, 150]}
noise: {sigma_mm: 0.03}
loads:
  - {name: weight, fz_N: -4000}
"""
DEGREES = (
    (0, 20, -10, 30, 40, 0),
    (30, -10, 5, -40, 60, 20),
    (-40, 35, -25, 70, -50, 60),
    (60, 5, 20, -80, 35, -45),
    (-75, 25, -5, 15, 75, 90),
    (15, 45, 10, -20, -65, -120),
)
START = datetime.datetime(2026, 3, 9, 9, 30, tzinfo=datetime.UTC)
FRAME = Frame("", exponential(np.array([0.02, -0.05, 0.7])), np.array([3.2, -1.7, 0.4]))
VISIT, READ = 60.0, 20.0
"""s from pose to pose, and from the unloaded to the loaded reading."""


@dataclass(frozen=True)
class Reading:
    """One point of the campaign: position in mm in the tracker's frame, time in s since START."""

    pose: str
    marker: str
    loaded: bool
    mm: tuple[float, float, float]
    time: float
    degrees: tuple[float, ...]

    @property
    def state(self) -> str:
        return "loaded" if self.loaded else "unloaded"

    @property
    def name(self) -> str:
        return f"{self.pose.upper()}_{self.marker}_{self.state}"

    @property
    def moment(self) -> datetime.datetime:
        return START + datetime.timedelta(seconds=self.time)


@dataclass(frozen=True)
class Campaign:
    """Experiment, plan and readings.csv in a folder, and the readings as records."""

    folder: Path
    experiment: Experiment
    plan: Plan
    readings: tuple[Reading, ...]

    def truth(self, *columns: str) -> Path:
        """readings.csv as somebody would type it, with some of the optional columns."""
        header = ["pose", *(f"q{k}_deg" for k in range(1, 7)), "fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm"]
        header += ["marker", "state", "x_mm", "y_mm", "z_mm", *columns]
        rows: list[list[str]] = []
        for r in self.readings:
            force = ["0", "0", "-4000", "0", "0", "0"] if r.loaded else [""] * 6
            more = {"time_s": number(r.time)}
            row = [r.pose, *(number(v, 12) for v in r.degrees), *force, r.marker, r.state, *map(number, r.mm)]
            rows.append(row + [more[c] for c in columns])
        path = self.folder / "readings.csv"
        write_table(path, header, rows, [f"robot: {self.experiment.robot.name}"])
        return path

    def write(self, name: str, text: str, encoding: str = "utf-8") -> Path:
        path = self.folder / name
        path.write_bytes(text.encode(encoding))
        return path


def make_campaign(folder: Path) -> Campaign:
    """Six poses, two markers, unloaded and loaded; the load sinks the markers by 2 to 4 mm."""
    (folder / "experiment.yaml").write_text(EXPERIMENT)
    experiment = load_experiment(folder / "experiment.yaml")
    pendant = np.deg2rad(np.array(DEGREES, dtype=float))
    wrench = np.tile([0.0, 0.0, -4000.0, 0.0, 0.0, 0.0], (len(pendant), 1))
    poses = Poses(pendant, experiment.robot.controller.to_joints(pendant), wrench)
    plan = make_plan(poses, ["weight"] * len(pendant))
    write_plan(folder / "plan.csv", plan, experiment)
    rng = np.random.default_rng(7)
    there = experiment.rigid_places(experiment.robot.controller.to_joints(pendant))
    readings: list[Reading] = []
    for i, pose in enumerate(plan.pose):
        for loaded in (False, True):
            for k, marker in enumerate(m.name for m in experiment.markers):
                place = there[i, k] + loaded * np.array([3e-4, 0.0, -2e-3 - 3e-4 * i]) + 3e-5 * rng.standard_normal(3)
                mm = tuple(round(v, 4) for v in (1e3 * FRAME.apply(place)).tolist())
                time = VISIT * i + READ * loaded + 2.0 * k + 5.0
                angles = tuple(float(v) for v in joint_cells(pendant[i], experiment.robot.controller.units))
                readings.append(Reading(pose, marker, loaded, mm, time, angles))
    return Campaign(folder, experiment, plan, tuple(readings))


def comma(value: float, digits: int = 4) -> str:
    return f"{value:.{digits}f}".replace(".", ",")


def lines(rows: Sequence[Sequence[str]], separator: str = ",") -> str:
    return "".join(separator.join(row) + "\n" for row in rows)


def spatial_analyzer(c: Campaign) -> Path:
    """Comments with //, then collection, group, target and coordinates; no heading."""
    head = "// SpatialAnalyzer\n// Frame: A::WORLD\n// Units: Millimeters\n"
    rows = [["A", f"{r.pose}_{r.state}", r.marker, *(f"{v:.6f}" for v in r.mm)] for r in c.readings]
    return c.write("sa_points.txt", head + lines(rows, ", "))


def spatial_analyzer_names(c: Campaign) -> Path:
    """Collection::Group::Target in one field, separated by blanks, in inches."""
    rows = [[f"A::{r.pose}::{r.marker}_{r.state}", *(repr(v / 25.4) for v in r.mm)] for r in c.readings]
    return c.write("sa_names.txt", "// Units: Inches\n" + lines(rows, " "))


def polyworks(c: Campaign) -> Path:
    """Object names with nominal, measured and deviation columns, separated by tabs."""
    head = ["Object Name", "Nominal X", "Nominal Y", "Nominal Z", "Measured X", "Measured Y", "Measured Z", "Dev 3D"]
    rows = [[r.name, "0.0", "0.0", "0.0", *(f"{v:.4f}" for v in r.mm), "0.0"] for r in c.readings]
    return c.write("polyworks.txt", "PolyWorks|Inspector\nUnits: mm\n" + lines([head, *rows], "\t"))


def tracker_pilot(c: Campaign) -> Path:
    """A measurement list with time stamp, scatter and weather; semicolons and decimal commas, as a German PC writes."""
    head = ["Name", "Zeitstempel", "X [mm]", "Y [mm]", "Z [mm]", "RMS [mm]", "Temperatur [°C]", "Druck [hPa]"]
    rows = [
        [r.name, r.moment.strftime("%d.%m.%Y %H:%M:%S"), *map(comma, r.mm), "0,0042", "21,5", "1013,2"]
        for r in c.readings
    ]
    return c.write("tracker_pilot.csv", lines([head, *rows], ";"), "cp1252")


def rts(c: Campaign) -> Path:
    """A log of a real-time recorder: counter, time in ms since its start, metres, UTF-16 as Windows tools write."""
    head = ["Index", "Time [ms]", "X [m]", "Y [m]", "Z [m]", "Quality", "Target"]
    rows = [
        [str(i), f"{1e3 * r.time:.0f}", *(f"{1e-3 * v:.7f}" for v in r.mm), "0", r.name]
        for i, r in enumerate(c.readings, start=1)
    ]
    return c.write("rts.csv", lines([head, *rows], ","), "utf-16")


def cam2(c: Campaign) -> Path:
    """A report of features: title lines, a heading, a line of units under it, in inches."""
    head = ["Feature", "X Actual", "Y Actual", "Z Actual", "X Nominal", "Y Nominal", "Z Nominal"]
    unit = ["", *["[in]"] * 6]
    rows = [[r.name, *(repr(v / 25.4) for v in r.mm), "0", "0", "0"] for r in c.readings]
    return c.write("cam2.csv", "CAM2 Measure\nOperator;N.N.\n" + lines([head, unit, *rows], ";"))


def api(c: Campaign) -> Path:
    """Point names and coordinates with their unit in every cell, date and time in columns of their own."""
    head = ["Point ID", "Date", "Time", "X", "Y", "Z"]
    rows = [
        [r.name, r.moment.strftime("%Y-%m-%d"), r.moment.strftime("%H:%M:%S"), *(f"{v:.4f} mm" for v in r.mm)]
        for r in c.readings
    ]
    return c.write("api.csv", lines([head, *rows], ","))


def workbook(c: Campaign, sheets: Sequence[str] = ("Points",)) -> Path:
    """A workbook with a title above the table."""
    import openpyxl

    book = openpyxl.Workbook()
    book.remove(book.active)
    for name in sheets:
        sheet = book.create_sheet(name)
        sheet.append(["Measured points"])
        sheet.append(["Point name", "X (mm)", "Y (mm)", "Z (mm)", "Comment"])
        for r in c.readings:
            sheet.append([r.name, *r.mm, None])
    book.create_sheet("Empty")
    path = c.folder / "points.xlsx"
    book.save(path)
    return path


def unnamed(c: Campaign) -> Path:
    """Coordinates alone, in the order of the plan."""
    return c.write("xyz.csv", lines([["X mm", "Y mm", "Z mm"], *([f"{v:.4f}" for v in r.mm] for r in c.readings)]))


def half_named(c: Campaign, state: str) -> Path:
    """One file for each state, points counted."""
    own = [r for r in c.readings if r.state == state]
    rows = [[f"Pt{i:03d}", *(f"{v:.4f}" for v in r.mm)] for i, r in enumerate(own, start=1)]
    return c.write(f"{state}.csv", lines([["Name", "x_mm", "y_mm", "z_mm"], *rows]))


FORMATS: dict[str, tuple[Callable[[Campaign], Path], tuple[str, ...], tuple[str, ...]]] = {
    "SpatialAnalyzer, points": (
        spatial_analyzer,
        ("--map", "collection=1,group=2,name=3,x=4,y=5,z=6"),
        (),
    ),
    "SpatialAnalyzer, full names": (spatial_analyzer_names, ("--map", "name=1,x=2,y=3,z=4"), ()),
    "PolyWorks": (polyworks, (), ()),
    "Leica Tracker Pilot": (tracker_pilot, (), ("time_s", "temperature_degC")),
    "Leica RTS": (rts, (), ("time_s",)),
    "FARO CAM2": (cam2, (), ()),
    "API": (api, (), ("time_s",)),
    "Excel": (workbook, (), ()),
}
"""How each program's sample is made, what must be stated, and which optional columns come with it."""


def moves(c: Campaign, step: float = 0.5) -> list[tuple[float, Array]]:
    """Clock and angles (deg) of a controller every `step` seconds: still at each pose, on the way between them."""
    out: list[tuple[float, Array]] = []
    stands = [np.array(d, dtype=float) for d in DEGREES]
    for i, here in enumerate(stands):
        end = VISIT * i + READ + 20.0
        out += [(t, here) for t in np.arange(VISIT * i, end, step).tolist()]
        if i + 1 < len(stands):
            way = np.arange(end, VISIT * (i + 1), step).tolist()
            out += [(t, here + (stands[i + 1] - here) * (k + 1) / (len(way) + 1)) for k, t in enumerate(way)]
    return out


def fanuc_log(c: Campaign) -> Path:
    """One row for each pose, as a KAREL program writes them: name and angles."""
    rows = [[p, *(repr(v) for v in d)] for p, d in zip(c.plan.pose, DEGREES, strict=True)]
    head = ["Pose", *(f"J{k} (deg)" for k in range(1, 7))]
    return c.write("fanuc_log.csv", lines([head, *rows]))


def fanuc_positions(c: Campaign) -> Path:
    """The positions of a FANUC listing, with the names that were given to them."""
    out = ["/PROG  CAMPAIGN", "/POS"]
    for i, (pose, angles) in enumerate(zip(c.plan.pose, DEGREES, strict=True), start=1):
        axes = ", ".join(f"J{k}= {v:9.3f} deg" for k, v in enumerate(angles, start=1))
        out += [f'P[{i}:"{pose}"]{{', "   GP1:", "  UF : 0, UT : 1,", f"  {axes}", "};"]
    return c.write("campaign.ls", "\n".join([*out, "/END"]) + "\n")


def kuka_positions(c: Campaign) -> Path:
    """The points of a KUKA programme."""
    rows = [
        f"DECL E6AXIS X{pose.upper()}={{{','.join(f'A{k} {v:.3f}' for k, v in enumerate(angles, start=1))},E1 0.0}}"
        for pose, angles in zip(c.plan.pose, DEGREES, strict=True)
    ]
    return c.write("campaign.dat", "\n".join(["&ACCESS RVO", "DEFDAT CAMPAIGN", *rows, "ENDDAT"]) + "\n")


def exported(c: Campaign, to: str) -> Path:
    """The plan as `qsf export` writes it; of a KUKA module the .src."""
    made = replace(draft(c.experiment, c.plan), title="an arm")
    ending = {"fanuc-ls": ".ls", "krl": ".src", "rapid": ".mod", "urscript": ".script"}[to]
    return export(made, to, c.folder / f"campaign{ending}")[0]


def kuka_log(c: Campaign) -> Path:
    """A trace as text: times of the day and $AXIS_ACT, separated by tabs."""
    head = ["Time", *(f"$AXIS_ACT.A{k}" for k in range(1, 7))]
    rows = []
    for t, angles in moves(c):
        moment = START + datetime.timedelta(seconds=t)
        rows.append([moment.strftime("%Y-%m-%d %H:%M:%S.%f"), *(f"{v:.6f}" for v in angles.tolist())])
    return c.write("kuka_trace.txt", lines([head, *rows], "\t"))


def ros_log(c: Campaign, ahead: float = 0.0, rate: float = 1.0) -> Path:
    """A bag's joint states as CSV: nanoseconds since 1970, names counted from 0, radians."""
    head = ["%time", "field.header.seq", *(f"field.position{k}" for k in range(6)), "field.velocity0"]
    rows = []
    for i, (t, angles) in enumerate(moves(c)):
        stamp = round((START.timestamp() + ahead + rate * t) * 1e9)
        rows.append([str(stamp), str(i), *(repr(v) for v in np.deg2rad(angles).tolist()), "0.0"])
    return c.write("joint_states.csv", lines([head, *rows]))
