"""Layouts in which programs and people write points and joints: each function writes one of a campaign.

They were written after public descriptions and public example files of the programs, and after sheets as people make
them. Each gives the arguments of the import beside the experiment and the plan.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import samples
from samples import DEGREES, Campaign, Reading, comma, lines

LAYOUTS: dict[str, Layout] = {}
Made = list[str | Path]
Layout = Callable[[Campaign], Made]


def layout(what: str) -> Callable[[Layout], Layout]:
    """A layout of docs/records/import-layouts.csv, by its words there."""

    def keep(make: Layout) -> Layout:
        LAYOUTS[what] = make
        return make

    return keep


def visits(c: Campaign) -> list[list[Reading]]:
    """The readings of each pose and state."""
    return [list(c.readings[i : i + 2]) for i in range(0, len(c.readings), 2)]


def flat(visit: Sequence[Reading], digits: int = 4, scale: float = 1.0) -> list[str]:
    return [f"{scale * v:.{digits}f}" for r in visit for v in r.mm]


def cells(r: Reading) -> list[str]:
    return [f"{v:.4f}" for v in r.mm]


def motive(c: Campaign, body: bool) -> Path:
    """A take of Motive 1.23: metres, a line of properties, five heading rows; body: with a rigid body's pose."""
    start = "2026-03-09 09.30.00.000 AM"
    said = ["Format Version", "1.23", "Take Name", "cell", "Capture Frame Rate", "120.0", "Export Frame Rate", "120.0"]
    said += ["Capture Start Time", start, "Total Frames in Take", "12", "Rotation Type", "Quaternion"]
    said += ["Length Units", "Meters", "Coordinate Space", "Global"]
    own = 7 if body else 0
    heads = [
        ["", "", *["Rigid Body"] * own, *["Marker"] * 6],
        ["", "", *["flange"] * own, *["flange:m1"] * 3, *["flange:m2"] * 3],
        ["", "", *['"5B2A"'] * own, *["1"] * 3, *["2"] * 3],
        ["", "", *["Rotation"] * 4 * body, *["Position"] * (3 * body + 6)],
        ["Frame", "Time (Seconds)", *["X", "Y", "Z", "W"] * body, *["X", "Y", "Z"] * (body + 2)],
    ]
    rows: list[list[str]] = []
    for i, visit in enumerate(visits(c)):
        pose = ["0.1", "0.2", "0.3", "0.9", f"{1 + 0.1 * i:.4f}", "2.0", "3.0"] * body
        rows.append([str(i), f"{i / 120:.6f}", *pose, *flat(visit, 7, 1e-3)])
    return c.write("motive.csv", lines([said]) + "\n" + lines([*heads, *rows]))


@layout("OptiTrack Motive: properties, five heading rows, a block for each marker, metres")
def motive_markers(c: Campaign) -> Made:
    return [motive(c, False)]


@layout("OptiTrack Motive with the pose of a rigid body before the markers")
def motive_body(c: Campaign) -> Made:
    return [motive(c, True)]


def vicon(c: Campaign, rows: Sequence[Sequence[str]]) -> Path:
    heads = [["", "", "arm:m1", "", "", "arm:m2", "", ""], ["Frame", "Sub Frame", *["X", "Y", "Z"] * 2]]
    heads.append(["", "", *["mm"] * 6])
    return c.write("vicon.csv", "Trajectories\n100\n" + lines([*heads, *rows]))


@layout("Vicon Nexus: names over the first column of each block, a line of units")
def vicon_rows(c: Campaign) -> Made:
    return [vicon(c, [[str(i), "0", *flat(v)] for i, v in enumerate(visits(c), start=1)])]


QTM = ["NO_OF_FRAMES\t12", "NO_OF_CAMERAS\t8", "NO_OF_MARKERS\t2", "FREQUENCY\t1", "DATA_INCLUDED\t3D"]


@layout("Qualisys QTM: lines of properties, `m1 X` ... as headings")
def qtm(c: Campaign) -> Made:
    head = ["Frame", "Time", *(f"{m} {a}" for m in ("m1", "m2") for a in "XYZ")]
    rows = [[str(i), f"{i:.3f}", *flat(v)] for i, v in enumerate(visits(c), start=1)]
    return [c.write("qtm.tsv", "\n".join([*QTM, "MARKER_NAMES\tm1\tm2"]) + "\n" + lines([head, *rows], "\t"))]


@layout("Qualisys QTM without headings: the markers in a line of properties")
def qtm_bare(c: Campaign) -> Made:
    rows = [flat(v) for v in visits(c)]
    return [c.write("qtm.tsv", "\n".join([*QTM, "MARKER_NAMES\tm1\tm2"]) + "\n" + lines(rows, "\t"))]


@layout("OpenSim TRC: names in one heading row, X1 Y1 Z1 X2 ... in the next")
def trc(c: Campaign) -> Made:
    head = ["PathFileType\t4\t(X/Y/Z)\tarm.trc", "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate"]
    head += ["100\t100\t12\t2\tmm\t100", "Frame#\tTime\tm1\t\t\tm2\t\t", "\t\tX1\tY1\tZ1\tX2\tY2\tZ2", ""]
    rows = [[str(i), f"{i / 100:.3f}", *flat(v)] for i, v in enumerate(visits(c), start=1)]
    return [c.write("arm.trc", "\n".join(head) + "\n" + lines(rows, "\t"))]


@layout("NDI Optotrak: `Marker_1 x` ..., the words for the markers stated")
def optotrak(c: Campaign) -> Made:
    head = ["Frame", *(f"Marker_{m} {a}" for m in (1, 2) for a in "xyz")]
    rows = [[str(i), *flat(v)] for i, v in enumerate(visits(c), start=1)]
    words = ["--word", "Marker_1=m1", "--word", "Marker_2=m2", "--unit", "mm"]
    return [c.write("optotrak.csv", lines([head, *rows])), *words]


@layout("pandas: two levels of columns and the index's name in a row of its own")
def pandas_levels(c: Campaign) -> Made:
    heads = [["marker", *["m1"] * 3, *["m2"] * 3], ["axis", *"xyzxyz"], ["visit", *[""] * 6]]
    rows = [[f"{v[0].pose}_{v[0].state}", *flat(v)] for v in visits(c)]
    return [c.write("frame.csv", lines([*heads, *rows])), "--map", "name=visit", "--unit", "mm"]


@layout("one row a visit, `m1_x_mm` ... as headings, pose and state in columns")
def one_row_a_visit(c: Campaign) -> Made:
    head = ["pose", "state", *(f"{m}_{a}_mm" for m in ("m1", "m2") for a in "xyz")]
    return [c.write("visits.csv", lines([head, *([v[0].pose, v[0].state, *flat(v)] for v in visits(c))]))]


@layout("one row a point, blocks of columns for the states under merged cells (Excel)")
def states_beside(c: Campaign) -> Made:
    import openpyxl

    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(["Cell 7, 9 March"])
    sheet.append(["Point", "unloaded [mm]", None, None, "loaded [mm]", None, None, "remark"])
    sheet.append([None, "X", "Y", "Z", "X", "Y", "Z", None])
    for i in range(0, len(c.readings), 4):
        for k in (0, 1):
            before, after = c.readings[i + k], c.readings[i + 2 + k]
            sheet.append([f"{before.pose} {before.marker}", *before.mm, *after.mm, "ok" if i else None])
    sheet.merge_cells("B2:D2")
    sheet.merge_cells("E2:G2")
    path = c.folder / "states.xlsx"
    book.save(path)
    return [path]


@layout("one row a pose, marker over state over axis: three heading rows, decimal commas")
def three_levels(c: Campaign) -> Made:
    heads = [
        ["Stellung", "m1", *[""] * 5, "m2", *[""] * 5],
        ["", *["unbelastet", "", "", "belastet", "", ""] * 2],
        ["", *["X [mm]", "Y [mm]", "Z [mm]"] * 4],
    ]
    rows: list[list[str]] = []
    for i in range(0, len(c.readings), 4):
        four = [c.readings[i + k] for k in (0, 2, 1, 3)]
        rows.append([four[0].pose, *(comma(v) for r in four for v in r.mm)])
    return [c.write("stellungen.csv", lines([*heads, *rows], ";"), "cp1252")]


@layout("nominal and measured under two headings, as PolyWorks tables show them")
def nominal_and_measured(c: Campaign) -> Made:
    heads = [["Name", "Nominal", "", "", "Measured", "", "", "Dev"], ["", *["X", "Y", "Z"] * 2, "3D"]]
    rows = [[r.name, "0", "0", "0", *cells(r), "0"] for r in c.readings]
    return [c.write("polyworks.txt", "Units: mm\n" + lines([*heads, *rows], "\t"))]


@layout("a line of units without brackets under the headings")
def bare_units(c: Campaign) -> Made:
    heads = [["Target", "X", "Y", "Z", "Temp"], ["", "mm", "mm", "mm", "°C"]]
    return [c.write("points.csv", lines([*heads, *([r.name, *cells(r), ""] for r in c.readings)]))]


@layout("a line of units with `-` where there is none")
def dashed_units(c: Campaign) -> Made:
    heads = [["Target", "X", "Y", "Z", "Quality"], ["-", "mm", "mm", "mm", "%"]]
    return [c.write("points.csv", lines([*heads, *([r.name, *cells(r), "99"] for r in c.readings)], ";"))]


@layout("lines of text padded with separators above the table, as Excel saves a sheet")
def padded_text(c: Campaign) -> Made:
    above = [["Cell 7", "", "", "", ""], ["Operator", "R2 D2", "", "", ""], ["", "", "", "", ""]]
    rows = [[r.name, *cells(r), ""] for r in c.readings]
    return [c.write("sheet.csv", lines([*above, ["Name", "X [mm]", "Y [mm]", "Z [mm]", "Remark"], *rows]))]


@layout("two exports in one file, the headings in both")
def two_exports(c: Campaign) -> Made:
    head = ["name", "x_mm", "y_mm", "z_mm"]
    rows = [[r.name, *cells(r)] for r in c.readings]
    return [c.write("points.csv", lines([head, *rows[:10], head, *rows[10:]]))]


@layout("headings in a line that begins with #, as numpy and gnuplot write them")
def in_a_comment(c: Campaign) -> Made:
    rows = [[r.name, *cells(r)] for r in c.readings]
    return [c.write("points.dat", "# made by a script\n# name x_mm y_mm z_mm\n" + lines(rows, " "))]


@layout("JSON of poses with their joints as lists, a point for each marker")
def json_joints(c: Campaign) -> Made:
    rows = [
        json.dumps(
            {"pose": v[0].pose, "state": v[0].state, "joints": [float(np.deg2rad(d)) for d in v[0].degrees]}
            | {r.marker: dict(zip("xyz", r.mm, strict=True)) for r in v}
        )
        for v in visits(c)
    ]
    return [c.write("poses.jsonl", "\n".join(rows)), "--unit", "mm"]


@layout("SpatialAnalyzer with tolerances, uncertainties and offsets beside the coordinates")
def analyzer_details(c: Campaign) -> Made:
    head = [
        "Collection",
        "Group",
        "Target",
        "X",
        "Y",
        "Z",
        "Tol X",
        "Tol Y",
        "Tol Z",
        "U X",
        "U Y",
        "U Z",
        "Planar Offset",
    ]
    rows = [["A", f"{r.pose}_{r.state}", r.marker, *cells(r), *["0.1"] * 3, *["0.02"] * 3, "0"] for r in c.readings]
    return [c.write("sa.csv", "// Units: Millimeters\n" + lines([head, *rows]))]


def report(c: Campaign, more: str, unit: str, factor: float) -> str:
    out: list[str] = []
    for i, r in enumerate(c.readings, start=1):
        out += [f"DIM LOC{i}= LOCATION OF SPHERE {r.name}  UNITS={unit}{more}"]
        out += ["AX    NOMINAL       +TOL       -TOL       MEAS        DEV     OUTTOL"]
        for axis, v in zip("XYZ", r.mm, strict=True):
            value = repr(v / factor)
            out += [f"{axis}    {round(v / factor)}.0 0.500 0.500   {value} 0.000 0.000"]
        out += [""]
    return "\n".join(out)


@layout("PC-DMIS report: a dimension with one axis a line")
def pcdmis(c: Campaign) -> Made:
    return [c.write("report.txt", report(c, "", "MM", 1.0))]


@layout("PC-DMIS report in inches with its output options")
def pcdmis_inches(c: Campaign) -> Made:
    return [c.write("report.txt", report(c, " ,$ GRAPH=OFF TEXT=OFF MULT=10.00 OUTPUT=BOTH", "IN", 25.4))]


@layout("one axis a row with nominal, actual and deviation, as GOM and Calypso tables")
def one_axis_a_row(c: Campaign) -> Made:
    head = ["Element", "Property", "Nominal", "Actual [mm]", "Deviation"]
    rows = [[r.name, a, "0", f"{v:.4f}", "0"] for r in c.readings for a, v in zip("XYZ", r.mm, strict=True)]
    return [c.write("elements.csv", lines([head, *rows], ";"))]


@layout("one axis a row, the axis at the end of the name")
def axis_in_the_name(c: Campaign) -> Made:
    rows = [[f"{r.name}.{a}", f"{v:.4f}"] for r in c.readings for a, v in zip("XYZ", r.mm, strict=True)]
    return [c.write("values.csv", lines([["Characteristic", "Value [mm]"], *rows]))]


@layout("JSON, one object a line, the point as a list")
def json_lines(c: Campaign) -> Made:
    rows = [json.dumps({"name": r.name, "position_mm": list(r.mm), "quality": None}) for r in c.readings]
    return [c.write("points.jsonl", "\n".join(rows) + "\n")]


@layout("JSON, a list of objects within objects")
def json_list(c: Campaign) -> Made:
    rows = [
        {"pose": r.pose, "marker": r.marker, "state": r.state, "position": dict(zip("xyz", r.mm, strict=True))}
        for r in c.readings
    ]
    return [c.write("points.json", json.dumps({"points": rows}["points"], indent=1)), "--unit", "mm"]


@layout("Leica with a probe's quaternion, the reflector's type and no names")
def leica_probe(c: Campaign) -> Made:
    head = ["X  [mm]", "Y  [mm]", "Z  [mm]", "U(95) X  [mm]", "Tilt  [deg]", "Q0 ", "Q1 ", "Q2 ", "Q3 ", "Target"]
    head += ["Temperature  [°C]", "Time Stamp", "Delete"]
    rows = [
        [
            *cells(r),
            "0.008",
            "12.0",
            "0.5",
            "0.5",
            "-0.5",
            "0.5",
            "TMC 30-B #1234",
            "",
            f"'{r.moment:%d.%m.%Y %H:%M:%S}",
            "",
        ]
        for r in c.readings
    ]
    return [c.write("leica.csv", lines([head, *rows]), "cp1252")]


@layout("the reflector's type of each point in a column of its own")
def reflector_types(c: Campaign) -> Made:
    rows = [[r.name, *cells(r), "RRR 1.5 in" if r.marker == "m1" else "TBR 0.5 in"] for r in c.readings]
    return [c.write("points.csv", lines([["Point", "X [mm]", "Y [mm]", "Z [mm]", "Reflector"], *rows]))]


@layout("dates that can be read in two ways, in a column that no join needs")
def two_way_dates(c: Campaign) -> Made:
    rows = [[r.name, f"03/04/2026 10:{i:02d}", *cells(r)] for i, r in enumerate(c.readings)]
    return [c.write("points.csv", lines([["Name", "Time Stamp", "X [mm]", "Y [mm]", "Z [mm]"], *rows]))]


@layout("V-STARS: name, coordinates and their sds between blanks, without headings")
def vstars(c: Campaign) -> Made:
    rows = [[r.name, *cells(r), "0.011", "0.012", "0.013"] for r in c.readings]
    return [c.write("bundle.xyz", lines(rows, "  ")), "--unit", "mm"]


@layout("MATLAB `writetable`: a matrix as pos_1, pos_2, pos_3")
def matlab(c: Campaign) -> Made:
    rows = [[r.pose, r.marker, r.state, *cells(r)] for r in c.readings]
    return [
        c.write("table.csv", lines([["pose", "marker", "state", "pos_1", "pos_2", "pos_3"], *rows])),
        "--unit",
        "mm",
    ]


@layout("ROS `rostopic echo -p` of points, two stamps and no names")
def ros_points(c: Campaign) -> Made:
    head = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id"]
    head += [f"field.point.{a}" for a in "xyz"]
    rows: list[list[str]] = []
    for i, r in enumerate(c.readings):
        stamp = str(round(r.moment.timestamp() * 1e9))
        rows.append([stamp, str(i), stamp, "tracker", *(f"{1e-3 * v:.7f}" for v in r.mm)])
    return [c.write("points.csv", lines([head, *rows])), "--unit", "m"]


@layout("a report with title lines above and signatures below the table")
def with_a_footer(c: Campaign) -> Made:
    text = "Inspection report\nOperator: N.N.\n\n" + lines([["Label", "X (mm)", "Y (mm)", "Z (mm)"]], ";")
    text += lines([[r.name, *map(comma, r.mm)] for r in c.readings], ";") + "\nEnd of report\nSignature:\n"
    return [c.write("report.csv", text)]


@layout("fixed-width columns between blanks with a line of units")
def fixed_width(c: Campaign) -> Made:
    rows = [f"{r.name:<22}" + "".join(f"{v:>14.4f}" for v in r.mm) for r in c.readings]
    head = [
        "POINT                          X             Y             Z",
        "                             [mm]          [mm]          [mm]",
    ]
    return [c.write("points.prn", "\n".join([*head, *rows]) + "\n")]


@layout("the robot's own position beside the tracker's")
def robots_own_position(c: Campaign) -> Made:
    head = ["name", "TCP X [mm]", "TCP Y [mm]", "TCP Z [mm]", "Leica X [mm]", "Leica Y [mm]", "Leica Z [mm]"]
    return [c.write("both.csv", lines([head, *([r.name, "1000.0", "0.0", "1500.0", *cells(r)] for r in c.readings)]))]


@layout("one block that is no marker: the prism at the base")
def block_of_the_base(c: Campaign) -> Made:
    head = ["pose", "state", *(f"{m} {a} [mm]" for m in ("m1", "m2", "base") for a in "XYZ")]
    rows = [[v[0].pose, v[0].state, *flat(v), "0.1", "0.2", "0.3"] for v in visits(c)]
    return [c.write("visits.csv", lines([head, *rows]))]


@layout("joints that are not all there beside the points")
def some_joints(c: Campaign) -> Made:
    rows = [[r.name, *map(str, r.degrees[:3]), *cells(r)] for r in c.readings]
    return [c.write("points.csv", lines([["name", "J1", "J2", "J3", "x_mm", "y_mm", "z_mm"], *rows]))]


@layout("joints in degrees beside the points, counted from 0")
def joints_beside(c: Campaign) -> Made:
    head = ["name", *(f"joint_{k} [deg]" for k in range(6)), "x_mm", "y_mm", "z_mm"]
    return [c.write("points.csv", lines([head, *([r.name, *map(repr, r.degrees), *cells(r)] for r in c.readings)]))]


def points(c: Campaign) -> Path:
    """An ordinary point list."""
    return c.write("points.csv", lines([["name", "x_mm", "y_mm", "z_mm"], *([r.name, *cells(r)] for r in c.readings)]))


def log(
    c: Campaign, head: Sequence[str], order: Sequence[int] = range(6), more: Sequence[str] = (), by: str = ","
) -> Path:
    """One row of radians for each pose."""
    rows = [[*more, *(repr(float(np.deg2rad(d)[k])) for k in order)] for d in np.array(DEGREES, dtype=float)]
    return c.write("joints.csv", lines([head, *rows], by))


@layout("ROS joint states whose names stand in another order than the arm's")
def ros_names(c: Campaign) -> Made:
    order = (2, 1, 0, 3, 4, 5)
    head = [*(f"field.name{k}" for k in range(6)), *(f"field.position{k}" for k in range(6))]
    names = [c.experiment.robot.facts.driven[k] for k in order]
    return [points(c), log(c, head, order, names), "--join", "order"]


@layout("ROS 2 joint states as PlotJuggler writes them, by the joints' names")
def plotjuggler(c: Campaign) -> Made:
    head = [f"/joint_states/{name}/position" for name in c.experiment.robot.facts.driven]
    return [points(c), log(c, head), "--join", "order"]


@layout("RTDE recording between blanks: actual_q_0 ..., with targets and the tool's pose")
def rtde(c: Campaign) -> Made:
    head = ["timestamp", *(f"target_q_{k}" for k in range(6)), *(f"actual_q_{k}" for k in range(6))]
    return [points(c), log(c, head, (*range(6), *range(6)), ["12.5"], " "), "--join", "order"]


@layout("points and a joint log in degrees, both without headings")
def no_headings(c: Campaign) -> Made:
    log = c.write("joints.txt", lines([map(str, d) for d in DEGREES], " "))
    named = c.write("points.txt", lines([[r.name, *cells(r)] for r in c.readings], " "))
    columns = ",".join(("name=1,x=2,y=3,z=4", *(f"q{k}={k}" for k in range(1, 7))))
    return [named, log, "--join", "order", "--map", columns]


@layout("a log of q0 ... q5 in radians without a unit")
def from_zero(c: Campaign) -> Made:
    return [points(c), log(c, [f"q{k}" for k in range(6)]), "--join", "order"]


@layout("our own programme of the plan, exported for ABB")
def own_programme(c: Campaign) -> Made:
    return [points(c), samples.exported(c, "rapid")]
