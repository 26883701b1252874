"""A programme that exists already: its points corrected, everything else as it was, malformed ones refused."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.errors import InputError
from qsframework.experiment import Experiment, load_experiment, make_plan, write_plan
from qsframework.plugin import Array, Poses
from qsframework.plugin.language import read_source
from qsframework.plugin.source import skeleton
from qsframework.uses.compensate import compensate
from qsframework.uses.inverse import rigid_tip
from qsframework.uses.programme_targets import ProgrammeOptions, corrected_texts, read_programme
from qsframework.uses.targets import joint_targets
from tests.applications.test_compensate import exact_fit

LS = """/PROG  DRILL
/ATTR
OWNER\t\t= MNEDITOR;
COMMENT\t\t= "two holes";
LINE_COUNT\t= 6;
/APPL
/MN
   1:  UFRAME_NUM=2 ;
   2:  UTOOL_NUM=3 ;
   3:J P[1] 20%% FINE    ;
   4:L P[2:"hole 1"] 250mm/sec FINE    ;
   5:  DO[4]=ON ;
   6:L P[3] 250mm/sec CNT100    ;
/POS
P[1]{
   GP1:
\tUF : 2, UT : 3,\t
\tJ1=    20.000 deg,\tJ2=    30.000 deg,\tJ3=   -10.000 deg,
\tJ4=     0.000 deg,\tJ5=    60.000 deg,\tJ6=     0.000 deg
};
P[2:"hole 1"]{
   GP1:
\tUF : 2, UT : 3,\t\tCONFIG : 'N U T, 0, 0, 0',
\tX =%s  mm,\tY =%s  mm,\tZ =%s  mm,
\tW =%s deg,\tP =%s deg,\tR =%s deg
   GP2:
\tUF : 2, UT : 3,\t
\tJ1=    45.000 deg
};
P[3]{
   GP1:
\tUF : 2, UT : 3,\t
\tJ1=   -25.500 deg,\tJ2=    20.000 deg,\tJ3=   -15.000 deg,
\tJ4=    10.000 deg,\tJ5=    70.000 deg,\tJ6=     5.000 deg
};
/END
"""
SRC = """&ACCESS RVP
DEF drill( )
;FOLD PTP P1 Vel=20 % PDAT1 Tool[3] Base[2]
BAS(#PTP_PARAMS,20)
PTP XP1
;ENDFOLD
LIN XP2 C_VEL
PTP {A1 -20.5, A2 -80, A3 100, A4 10, A5 40, A6 0}
WAIT SEC 1.0
END
"""
DAT = """&ACCESS RVP
DEFDAT drill
;the points
DECL E6AXIS XP1={A1 20.0,A2 -90.0,A3 110.0,A4 5.0,A5 30.0,A6 0.0,E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0}
DECL E6POS XP2={X %s,Y %s,Z %s,A %s,B %s,C %s,S 2,T 10,E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0}
DECL FDAT FP2={TOOL_NO 3,BASE_NO 2,IPO_FRAME #BASE}
ENDDAT
"""
TOOL = np.array([50.0, -30.0, 250.0, 10.0, -20.0, 30.0])
FRAME = np.array([900.0, -400.0, 120.0, 5.0, 3.0, -40.0])
PULL = np.array([0.0, 500.0, -1500.0, 0.0, 0.0, 0.0])
EULER = {"fanuc": "xyz", "kuka": "ZYX"}


def matrix(values: Array, maker: str) -> Array:
    """Written again here, from elementary turns."""
    x, y, z = np.deg2rad(values[3:] if maker == "fanuc" else values[:2:-1])
    rx = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
    ry = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
    rz = np.array([[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]])
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rz @ ry @ rx, values[:3] * 1e-3
    return out


def flange(experiment: Experiment, degrees: Array) -> Array:
    """The flange in the base frame by Pinocchio."""
    import pinocchio as pin

    robot = experiment.robot
    data = robot.model.createData()
    q = robot.controller.to_joints(np.deg2rad(degrees)[None])[0]
    pin.framesForwardKinematics(robot.model, data, q)
    return np.asarray(data.oMi[robot.model.njoints - 1].homogeneous @ robot.flange.placement)


def shown(place: Array, maker: str) -> Array:
    """Six numbers of a pose, away from the singular one."""
    r = place[:3, :3]
    y = np.arcsin(-r[2, 0])
    x, z = np.arctan2(r[2, 1], r[2, 2]), np.arctan2(r[1, 0], r[0, 0])
    turns = np.rad2deg([x, y, z] if maker == "fanuc" else [z, y, x])
    return np.concatenate([place[:3, 3] * 1e3, turns])


def in_frame(experiment: Experiment, degrees: Array, maker: str) -> Array:
    """What the controller shows of the tool in the user frame at these angles."""
    place = np.linalg.inv(matrix(FRAME, maker)) @ flange(experiment, degrees) @ matrix(TOOL, maker)
    return shown(place, maker)


HOLE = {"fanuc": np.array([25.0, 28.0, -12.0, 3.0, 62.0, 4.0]), "kuka": np.array([10.0, -85.0, 105.0, 8.0, 35.0, 5.0])}


@pytest.fixture(scope="module")
def kuka(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    path = tmp_path_factory.mktemp("kuka") / "experiment.yaml"
    lines = ["robot: kuka_kr270", "load: {point_mm: [20, 30, 200]}", "markers: {m1: {xyz_mm: [0, 0, 200]}}"]
    path.write_text("\n".join([*lines, "noise: {sigma_mm: 0.03}"]) + "\n")
    return load_experiment(path)


def write_ls(folder: Path, experiment: Experiment, ends: str = "\n") -> Path:
    cells = tuple(f"{v:11.4f}" for v in in_frame(experiment, HOLE["fanuc"], "fanuc"))
    path = folder / "drill.ls"
    path.write_bytes((LS % cells).replace("\n", ends).encode())
    return path


def write_krl(folder: Path, experiment: Experiment) -> Path:
    (folder / "drill.src").write_text(SRC)
    (folder / "drill.dat").write_text(DAT % tuple(f"{v:.5f}" for v in in_frame(experiment, HOLE["kuka"], "kuka")))
    return folder / "drill.src"


def options(**more: object) -> ProgrammeOptions:
    stated = {"loads": {"": PULL}, "tools": {"3": TOOL}, "frames": {"2": FRAME}}
    return ProgrammeOptions(**{**stated, **more})


@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_a_fanuc_programme(m900ib: Experiment, tmp_path: Path, ends: str) -> None:
    path = write_ls(tmp_path, m900ib, ends)
    asked = options(start=np.deg2rad(HOLE["fanuc"] + 2.0))
    made = read_programme(path, m900ib, asked)
    assert [p.name for p in made.points] == ["P[1]", "P[2]", "P[3]"]
    assert np.allclose(np.rad2deg(made.targets.pendant[1]), HOLE["fanuc"], atol=1e-3)
    stands = rigid_tip(m900ib.robot, m900ib.load_site, m900ib.robot.controller.to_joints(made.targets.pendant))
    assert np.abs(stands.position - made.targets.wanted.position).max() < 1e-6
    result = compensate(m900ib, exact_fit(m900ib), made.targets)
    again = joint_targets(m900ib, made.targets.pendant, made.targets.wrench)
    assert np.allclose(compensate(m900ib, exact_fit(m900ib), again).pendant, result.pendant, atol=1e-7)
    text = corrected_texts(made, result, m900ib)[path]
    old, new = path.read_bytes().decode().split(ends), text.split(ends)
    differ = [i for i, (a, b) in enumerate(zip(old, new, strict=True)) if a != b]
    assert differ == [17, 18, 23, 24, 32, 33], "the numbers of the three points alone"
    assert [len(a.expandtabs()) for a in new] == [len(a.expandtabs()) for a in old], "in their columns"
    found = re.findall(r"J\d= *(-?[\d.]+) deg", ends.join(new[15:20]))
    assert np.allclose([float(v) for v in found], np.rad2deg(result.pendant[0]), rtol=0.0, atol=1e-4)
    (tmp_path / "drill.ls").write_bytes(text.encode())
    back = read_programme(path, m900ib, asked)
    assert np.abs(np.rad2deg(back.targets.pendant - result.pendant)).max() < 2e-4
    place = (
        matrix(FRAME, "fanuc") @ matrix(_numbers(back.points[1].cells), "fanuc") @ np.linalg.inv(matrix(TOOL, "fanuc"))
    )
    assert np.abs(place - flange(m900ib, np.rad2deg(result.pendant[1]))).max() < 2e-6
    assert made.counts == {"corrected": 3, "kept": 0, "refused": 0}


def _numbers(cells: object) -> Array:
    return np.array([c.value for c in list(cells.values())[:6]])


def test_a_kuka_module(kuka: Experiment, tmp_path: Path) -> None:
    path = write_krl(tmp_path, kuka)
    made = read_programme(path, kuka, options(start=np.deg2rad(HOLE["kuka"])))
    assert [(p.name, p.path.suffix, p.line) for p in made.points] == [
        ("line 8", ".src", 8),
        ("XP1", ".dat", 4),
        ("XP2", ".dat", 5),
    ]
    assert np.allclose(np.rad2deg(made.targets.pendant[2]), HOLE["kuka"], atol=1e-3)
    result = compensate(kuka, exact_fit(kuka), made.targets)
    texts = corrected_texts(made, result, kuka)
    for file, text in texts.items():
        changed = [
            i for i, (a, b) in enumerate(zip(file.read_text().split("\n"), text.split("\n"), strict=True)) if a != b
        ]
        assert changed == ([7] if file.suffix == ".src" else [3, 4])
        file.write_text(text)
    assert "S 2,T 10,E1 0.0,E2 0.0" in texts[tmp_path / "drill.dat"]
    back = read_programme(tmp_path / "drill.dat", kuka, options(start=np.deg2rad(HOLE["kuka"])))
    assert np.abs(np.rad2deg(back.targets.pendant - result.pendant)).max() < 2e-4
    assert made.counts == {"corrected": 3, "kept": 0, "refused": 0}


def test_motions_that_are_kept_for_a_shared_point_are_named(m900ib: Experiment, tmp_path: Path) -> None:
    path = write_ls(tmp_path, m900ib)
    path.write_text(path.read_text().replace("L P[3]", "L P[1]"))
    made = read_programme(path, m900ib, options(keep=("line 10",)))
    assert [m.line for m in made.shared] == [13]
    assert any(note.startswith("kept too, for they go to a point of one that is kept: line 13") for note in made.notes)
    with pytest.raises(InputError, match=r"no motion stands in line 9 of the file; allowed: line 10, line"):
        read_programme(path, m900ib, options(keep=("line 9",)))


def test_points_that_are_kept_and_loads_of_their_own(m900ib: Experiment, tmp_path: Path) -> None:
    path = write_ls(tmp_path, m900ib)
    made = read_programme(
        path, m900ib, options(keep=("P[2]",), loads={"": PULL, "P[3]": 0.0 * PULL}, tools={}, frames={})
    )
    assert made.targets.wrench[:, 1].tolist() == [500.0, 0.0]
    result = compensate(m900ib, exact_fit(m900ib), made.targets)
    text = corrected_texts(made, result, m900ib)[path]
    assert path.read_text().split("P[2:")[2].split("P[3]")[0] in text
    assert skeleton(read_source(path)) != {path: text}


SPOILED = {
    "no head": ("/PROG", "PROG", r"drill.ls, line 1: is no whole FANUC listing: /PROG is missing"),
    "no end": ("/END\n", "", r"line 1: is no whole FANUC listing: /END is missing"),
    "no positions": ("/POS\n", "", r"line 1: is no whole FANUC listing: /POS is missing"),
    "not learned": (
        "J2=    30.000 deg",
        "J2= ******** deg",
        r"line 18: P\[1\]: J2 is no number with its unit; found \*{8}",
    ),
    "no unit": ("J2=    30.000 deg", "J2=    30.000", r"line 18: P\[1\]: J2 is no number with its unit; found 30.000"),
    "comma": ("J1=    20.000", "J1=    20,000", r"line 18: P\[1\]: J1 is no number with its unit; found 20"),
    "an axis lacks": ("\tJ3=   -10.000 deg,", "", r"line 15: P\[1\] lacks J3; found J1, J2, J4, J5, J6"),
    "beyond": (
        "J2=    30.000",
        "J2=   130.000",
        r"line 15: P\[1\]: J2 is outside its limits; found 130 deg; allowed: -64",
    ),
    "not closed": ("deg\n};\nP[3]", "deg\nP[3]", r"line 21: P\[2\] does not end"),
    "twice": ("P[3]{", "P[1]{", r"line 30: P\[1\] stands here a second time, first in line 15"),
    "not there": ("L P[3]", "L P[9]", r"line 13: P\[9\] is moved to, but has no position under /POS"),
    "no frame": ("UF : 2, UT : 3,\t\n\tJ1=    20", "\n\tJ1=    20", r"line 15: P\[1\] states no UF and UT"),
    "other frame": (
        "UF : 2, UT : 3,\t\tCON",
        "UF : 4, UT : 3,\t\tCON",
        r"line 21: P\[2\] is a pose, and nobody states frame 4",
    ),
    "one axis more": (
        "J6=     0.000 deg",
        "J6=     0.000 deg,\tE1=  10.000 mm",
        r"line 15: P\[1\]: the robot has no axis E1",
    ),
}


@pytest.mark.parametrize("spoiled", SPOILED)
def test_spoiled_listings(m900ib: Experiment, tmp_path: Path, spoiled: str) -> None:
    path = write_ls(tmp_path, m900ib)
    old, new, words = SPOILED[spoiled]
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1) if spoiled != "twice" else path.read_text().replace(old, new))
    with pytest.raises(InputError, match=words):
        read_programme(path, m900ib, options())


BROKEN = {
    "no end": (".src", "\nEND\n", "\n", r"drill.src, line 9: is no whole .src of KRL: END is missing"),
    "no head": (".dat", "DEFDAT", "DAT", r"drill.dat, line 1: is no whole .dat of KRL: DEFDAT is missing"),
    "open": (".dat", "E6 0.0}\nDECL E6POS", "E6 0.0\nDECL E6POS", r"drill.dat, line 4: XP1 does not end"),
    "word": (".dat", "A2 -90.0", "A2 down", r"drill.dat, line 4: XP1: A2 is no number of a point; found down"),
    "axis": (".dat", "A3 110.0,", "", r"drill.dat, line 4: XP1 lacks A3"),
    "rail": (
        ".dat",
        "S 2,T 10,E1 0.0",
        "S 2,T 10,E1 900.0",
        r"line 5: XP2: a pose beside external axes is not corrected",
    ),
    "inline": (".src", "A6 0}", "A6 0", r"drill.src, line 8: the point of this motion does not end"),
    "the others stay": (
        ".src",
        "PTP {A1 -20.5, A2 -80, A3 100, A4 10, A5 40, A6 0}",
        "PTP {A1 10}",
        r"line 8 lacks A2, A3, A4, A5, A6: they stay where the arm stands, and .* no number to go to; write all axes",
    ),
    "the others of a pose": (
        ".src",
        "PTP {A1 -20.5, A2 -80, A3 100, A4 10, A5 40, A6 0}",
        "LIN {Z 1500}",
        r"line 8 lacks X, Y, A, B, C: they stay where the arm stands",
    ),
    "beyond": (".src", "A1 -20.5", "A1 -220.5", r"drill.src, line 8: line 8: A1 is outside its limits"),
}


@pytest.mark.parametrize("broken", BROKEN)
def test_broken_modules(kuka: Experiment, tmp_path: Path, broken: str) -> None:
    path = write_krl(tmp_path, kuka)
    ending, old, new, words = BROKEN[broken]
    file = path.with_suffix(ending)
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new, 1))
    with pytest.raises(InputError, match=words):
        read_programme(path, kuka, options())


def test_what_is_not_stated(m900ib: Experiment, kuka: Experiment, tmp_path: Path) -> None:
    path = write_ls(tmp_path, m900ib)
    for more, words in (
        ({"loads": {}}, "does not say what pulls at its points. State the force for all of them"),
        ({"loads": {"": PULL, "P[7]": PULL}}, r"no point 'P\[7\]'; allowed: P\[1\], P\[2\], P\[3\]"),
        ({"tools": {}}, r"line 21: P\[2\] is a pose, and nobody states tool 3. As .* X, Y, Z, W, P, R in mm and deg"),
        ({"loads": {"": 5.0 * PULL}}, r"line 15: P\[1\]: the force is more than the robot's payload; found 7906 N"),
        ({"frames": {"2": 10.0 * FRAME}}, r"line 21: P\[2\]: no joint angles within the limits"),
        ({"keep": ("P[1]", "P[2]", "P[3]")}, "every point is to be kept"),
    ):
        with pytest.raises(InputError, match=words):
            read_programme(path, m900ib, options(**more))
    module = write_krl(tmp_path, kuka).with_suffix(".dat")
    module.write_text(module.read_text().replace("DECL FDAT FP2", ";"))
    start = np.deg2rad(HOLE["kuka"])
    with pytest.raises(
        InputError, match=r"line 5: XP2 is a pose, and nobody states tool \(the point names no number\)"
    ):
        read_programme(module, kuka, options(start=start))
    own = options(start=start, tools={"3": TOOL, "XP2": TOOL}, frames={"xp2": FRAME})
    assert np.allclose(np.rad2deg(read_programme(module, kuka, own).targets.pendant[2]), HOLE["kuka"], atol=1e-3)


def test_the_command(m900ib: Experiment, tmp_path: Path) -> None:
    path, fit = write_ls(tmp_path, m900ib), tmp_path / "fit.json"
    path.write_text(path.read_text().replace("CNT100", "CNT100 Offset,PR[7]"))
    plan = Path(m900ib.path).parent / "table5.csv"
    readings = tmp_path / "readings.csv"
    for line in (
        ["simulate", str(m900ib.path), str(plan), "-o", str(readings), "--truth", "drawn"],
        ["identify", str(m900ib.path), str(readings), "--json", str(fit)],
    ):
        assert CliRunner().invoke(app, line, catch_exceptions=False).exit_code == 0
    out = tmp_path / "corrected.ls"
    arguments = ["compensate", str(m900ib.path), str(fit), str(path), "-o", str(out)]
    stated = ["--load", "0,500,-1500", "--load", "P[1]=0,0,0", "--keep", "P[3]"]
    frames = ["--tool", "3=" + ",".join(map(str, TOOL)), "--frame", "2=" + ",".join(map(str, FRAME))]
    run = CliRunner().invoke(app, [*arguments, *stated, *frames, "--start", "25,28,-12,3,60,4"], catch_exceptions=False)
    assert run.exit_code == 0
    assert f"corrected programme, read back: {out}" in run.output
    assert "--- drill.ls" in run.output
    assert "-\tJ1=    20.000 deg,\tJ2=    30.000 deg," in run.output
    assert "+\tJ1=   " in run.output
    assert "3 motions: 2 corrected, 1 kept, 0 refused" in run.output
    assert "1 motions are kept as they are: line 13 L P[3] 250mm/sec CNT100 Offset,PR[7]" in " ".join(
        run.output.split()
    )
    assert "the configuration that the programme states was not read" in run.output
    assert read_source(out).points[2].cells["J1"].value == -25.5
    for more, words in (
        ([*stated, *frames, "-o", str(tmp_path / "x.csv")], "a programme is written as what it is"),
        (frames, "does not say what pulls"),
        ([*stated, *frames, "-o", str(path)], "drill.ls"),
    ):
        wrong = CliRunner().invoke(app, [*arguments, *more])
        assert isinstance(wrong.exception, InputError)
        assert words in str(wrong.exception)
    table = CliRunner().invoke(app, [*arguments[:3], "targets.csv", *stated])
    assert "is no programme; allowed: .mod, .modx, .prg, .sys, .sysx, .ls, .src, .dat, .script, .urscript" in str(
        table.exception
    )


EXT = """DEF EXT( )
PTP XP1
LIN XP2
LIN XGLOBAL
XP3=XP1
XP3.Z=XP3.Z+50
LIN XP3
LIN XP1:{X 0,Y 0,Z 100,A 0,B 0,C 0}
;LIN XP9
END
"""
EXT_DAT = """DEFDAT EXT
DECL E6POS XP1={X %s,Y %s,Z %s,A %s,B %s,C %s,S 2,T 35}
DECL FDAT FP1={TOOL_NO 3, BASE_NO 2, IPO_FRAME #BASE,POINT2[] " ",TQ_STATE FALSE}
DECL E6POS XP2={X 1800.0,Y 300.0,Z 1500.0,A 0.0,B 90.0,C 0.0,S 2,T 35}
DECL FDAT FP2={TOOL_NO 3, BASE_NO 2, IPO_FRAME #TCP,POINT2[] " ",TQ_STATE FALSE}
;Höhe
ENDDAT
"""


@pytest.fixture(scope="module")
def kuka_fit(kuka: Experiment) -> Path:
    folder = Path(kuka.path).parent
    pendant = np.deg2rad(HOLE["kuka"] + np.random.default_rng(3).uniform(-25.0, 25.0, (12, 6)))
    wrench = np.tile([0.0, 0.0, -1500.0, 0.0, 0.0, 0.0], (12, 1))
    write_plan(
        folder / "plan.csv",
        make_plan(Poses(pendant, kuka.robot.controller.to_joints(pendant), wrench), ["w"] * 12),
        kuka,
    )
    for line in (
        ["simulate", str(kuka.path), str(folder / "plan.csv"), "-o", str(folder / "r.csv"), "--truth", "drawn"],
        ["identify", str(kuka.path), str(folder / "r.csv"), "--json", str(folder / "fit.json")],
    ):
        assert CliRunner().invoke(app, line, catch_exceptions=False).exit_code == 0
    return folder / "fit.json"


def test_the_command_refuses_by_name_and_keeps_what_it_is_told_to(
    kuka: Experiment, kuka_fit: Path, tmp_path: Path
) -> None:
    """Fixed tool, points elsewhere, assigned, shifted: named, with what to do; the module stays Latin-1."""
    (tmp_path / "ext.src").write_text(EXT)
    place = tuple(f"{v:.5f}" for v in in_frame(kuka, HOLE["kuka"], "kuka"))
    (tmp_path / "ext.dat").write_bytes((EXT_DAT % place).encode("latin-1"))
    out = tmp_path / "out" / "ext.src"
    tool, frame = (f"{n}={','.join(map(str, v))}" for n, v in (("3", TOOL), ("2", FRAME)))
    line = ["compensate", str(kuka.path), str(kuka_fit), str(tmp_path / "ext.dat"), "-o", str(out)]
    line += ["--load", "0,0,-1500", "--frame", frame, "--start", "10,-85,105,8,35,5"]
    refused = CliRunner().invoke(app, [*line, "--tool", tool])
    assert isinstance(refused.exception, InputError)
    said = str(refused.exception)
    assert "5 motions: 1 can be corrected, 0 are kept, 4 are refused, so nothing is written" in said
    for words in (
        r"ext.src, line 3: the tool stands in the cell \(IPO_FRAME #TCP\) .*; found LIN XP2; .* keep 'line 3' as it is",
        r"ext.src, line 4: XGLOBAL has no position of numbers in this programme; found LIN XGLOBAL; .* keep 'XGLOBAL'",
        r"ext.src, line 7: XP3 gets its value in line 5 when the programme runs; found LIN XP3; .* keep 'XP3'",
        r"ext.src, line 8: XP1:{.*} is computed when the programme runs; found LIN XP1:{.*}; .* keep 'line 8'",
    ):
        assert re.search(words, said)
    assert not out.exists()
    other = CliRunner().invoke(app, [*line, "--keep", "refused", "--tool", tool.replace("3=", "1=", 1)])
    assert "XP1 is a pose, and nobody states tool 3" in str(other.exception)
    advice = [
        option for p in refused.exception.problems[1:] for option in (f"--{p.argument[0]}", p.argument[1].strip("'"))
    ]
    for keep in (["--keep", "refused"], advice):
        done = CliRunner().invoke(app, [*line, "--tool", tool, *keep], catch_exceptions=False)
        printed = " ".join(done.output.split())
        assert "5 motions: 1 corrected, 4 kept, 0 refused" in printed
        assert "Corrected, with notes" in printed
        assert "4 motions are kept as they are: line 3 LIN XP2; line 4 LIN XGLOBAL; line 7 LIN XP3; line 8" in printed
        assert "lines 5, 8 use corrected points by their names" in printed
        old, new = ((folder / "ext.dat").read_bytes().split(b"\n") for folder in (tmp_path, out.parent))
        assert [k for k, (a, b) in enumerate(zip(old, new, strict=True)) if a != b] == [1]
        assert "Höhe".encode("latin-1") in new[5]
        assert out.read_bytes() == EXT.encode()


def test_a_programme_of_another_maker(kuka: Experiment, m900ib: Experiment, tmp_path: Path) -> None:
    for experiment, name, text, words in (
        (kuka, "a.ls", LS % (("0",) * 6), "is a programme for controllers by FANUC; found KUKA KR270"),
        (m900ib, "a.mod", "MODULE a\nMoveL p,v100,fine,tool0;\nENDMODULE", "controllers by ABB; found FANUC M-900iB"),
        (m900ib, "b.script", "movej([0,0,0,0,0,0])\n", "controllers by UNIVERSAL ROBOTS"),
    ):
        (tmp_path / name).write_text(text)
        with pytest.raises(InputError, match=words):
            read_programme(tmp_path / name, experiment, options())


REFUSED = {
    "register": (
        "J P[1] 20%% FINE",
        "J PR[1:home] 20%% FINE",
        r"line 10: PR\[1\] is moved to, but is held by the contr",
    ),
    "offset": (
        "CNT100",
        "CNT100 Offset,PR[7]",
        r"line 13: it is shifted by a register when it runs; found L P\[3\] 250",
    ),
    "remote": ("250mm/sec FINE", "250mm/sec FINE RTCP", r"line 11: the tool stands in the cell \(remote TCP\)"),
    "positioner": ("GP2:", "GP1:", r"P\[2\] lacks J2"),
    "set": ("DO[4]=ON", "UFRAME[2]=PR[3]", r"line 21: P\[2\]: UFRAME\[2\] is set in line 12 when the programme runs"),
}


@pytest.mark.parametrize("refused", REFUSED)
def test_motions_that_are_not_corrected_are_refused_and_may_be_kept(
    m900ib: Experiment, tmp_path: Path, refused: str
) -> None:
    path, (old, new, words) = write_ls(tmp_path, m900ib), REFUSED[refused]
    text = path.read_text()
    old, new = old.replace("%%", "%"), new.replace("%%", "%")
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=words) as error:
        read_programme(path, m900ib, options())
    keep = tuple(p.argument[1].strip("'") for p in error.value.problems[1:] if p.argument is not None)
    made = read_programme(path, m900ib, options(keep=keep))
    assert made.counts["kept"] == 1
    assert sum(made.counts.values()) == 3
