"""`qsf new` on any URDF or table: a robot, or a refusal that says where and what, and whose advice works."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_denavit_file import product
from typer.testing import CliRunner

from qsf_onboarding.proposal import propose
from qsframework.cli.app import app
from qsframework.errors import InputError
from qsframework.robot import load_robot
from qsframework.robot.reference import reference_flange
from qsframework.robot.urdf import read_urdf

LINK = '<link name="{}"><inertial><mass value="20"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>\n'
JOINT = (
    '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/><origin xyz="{}"/><axis xyz="{}"/>'
    '<limit lower="-1" upper="1" effort="1" velocity="1"/>{}</joint>\n'
)
ARM = (
    ("j1", "revolute", "base", "turret", "0 0 0.5", "0 0 1", ""),
    ("j2", "revolute", "turret", "arm", "0.3 0 0.5", "0 1 0", ""),
    ("j3", "revolute", "arm", "fore", "0 0 1.2", "0 1 0", ""),
    ("j4", "revolute", "fore", "wrist", "0.9 0 0.2", "1 0 0", ""),
)
LOOP = (
    ("lever", "continuous", "turret", "crank", "0.3 0.2 0.5", "0 1 0", ""),
    ("bar", "continuous", "crank", "rod", "-0.5 0 0", "0 1 0", ""),
    ("tie", "continuous", "rod", "fore", "0 0 1.2", "0 1 0", ""),
)


def written(folder: Path, joints: tuple[tuple[str, ...], ...]) -> Path:
    links = dict.fromkeys(link for row in joints for link in row[2:4])
    text = "".join(LINK.format(name) for name in links) + "".join(JOINT.format(*row) for row in joints)
    (folder / "arm.urdf").write_text(f'<robot name="r">\n{text}</robot>\n')
    return folder / "arm.urdf"


def new(folder: Path, *arguments: str) -> str:
    """What `qsf new` prints on one line, and its exit status."""
    done = CliRunner().invoke(app, ["new", "arm", *arguments, "-o", str(folder / "arm")], env={"COLUMNS": "200"})
    if isinstance(done.exception, InputError):
        return str(done.exception)
    assert done.exception is None, done.exception
    return " ".join(done.output.split()) + f" {done.exit_code}"


def test_one_joint_is_a_robot(tmp_path: Path) -> None:
    assert new(tmp_path, "--urdf", str(written(tmp_path, ARM[:1]))).endswith(" 0")
    (tmp_path / "row.csv").write_text("a_mm,alpha_deg,d_mm,theta_deg\n0,0,0,0\n")
    (tmp_path / "arm").rename(tmp_path / "first")
    assert new(tmp_path, "--dh", str(tmp_path / "row.csv")).endswith(" 0")


def test_equal_names_are_refused(tmp_path: Path) -> None:
    file = written(tmp_path, (*ARM[:2], ("j2", *ARM[2][1:])))
    assert "line 8: joint 'j2' stands here again; it is also at line 7" in new(tmp_path, "--urdf", str(file))
    file.write_text(file.read_text().replace('<link name="fore">', '<link name="arm">'))
    assert "line 5: link 'arm' stands here again; it is also at line 4" in new(tmp_path, "--urdf", str(file))


def test_a_closed_chain_is_refused_with_a_way_that_works(tmp_path: Path) -> None:
    said = new(tmp_path, "--urdf", str(written(tmp_path, (*ARM, *LOOP))))
    assert re.search(r"line \d+: link 'fore' has two parents: joint 'j3' \(line \d+\) and joint 'tie'", said)
    assert "delete joint 'tie'" in said
    entries = re.findall(r"\{effect: .*?\}", said)
    assert ["parallelogram" in entries[0], "four_bar" in entries[1], len(entries)] == [True, True, 2]
    assert new(tmp_path, "--urdf", str(written(tmp_path, (*ARM, *LOOP[:2]))), "--flange", "wrist").endswith(" 0")
    spec = tmp_path / "arm" / "robot.yaml"
    text = spec.read_text().replace(
        'limits_deg: [-57.296, 57.296]}\n  "j4', 'limits_deg: [-57, 57], equals: J3 - J2}\n  "j4'
    )
    for entry in entries:
        spec.write_text(text.replace("effects:\n", f"effects:\n  - {entry}\n"))
        done = CliRunner().invoke(app, ["check", str(tmp_path / "arm")])
        assert done.exit_code == 0, done.output


@pytest.mark.parametrize("count", [900, 1000, 5000])
def test_long_chains_are_refused_at_once(count: int, tmp_path: Path) -> None:
    rows = [("j" + str(k), "revolute", f"l{k - 1}", f"l{k}", "0 0 0.1", "0 1 0", "") for k in range(1, count + 1)]
    said = new(tmp_path, "--urdf", str(written(tmp_path, tuple(rows))))
    if count > 900:
        assert re.search(r"holds .*1000|more than 50000 elements", said)
        return
    assert "joint 'j31' is one too many: 900 joints move from base to flange; allowed: up to 30" in said
    still = [(row[0], "fixed" if k > 5 else "revolute", *row[2:]) for k, row in enumerate(rows)]
    assert new(tmp_path, "--urdf", str(written(tmp_path, tuple(still)))).endswith(" 0")


def test_what_is_not_read_is_listed(tmp_path: Path) -> None:
    more = '<calibration rising="0.1"/><safety_controller k_velocity="1"/><spring k="4"/>'
    file = written(tmp_path, ((*ARM[0][:6], more), *ARM[1:]))
    file.write_text(file.read_text().replace("<origin xyz", '<origin quat="1 0 0 0" xyz', 1))
    said = new(tmp_path, "--urdf", str(file))
    for words in (
        "file: <calibration> is not read (line 7 of j1): do the zeros of the pendant and of the URDF agree?",
        "file: <safety_controller> is not read (line 7 of j1): where its soft limits are narrower",
        "file: <spring> is not read (line 7 of j1): unknown in <joint>",
        "file: quat= is not read (line 7): unknown in <origin>",
    ):
        assert words in said


CALIBRATED = """joint\ta_m\talpha_rad\td_m  \ttheta_rad
A1\t0.00011\t1.5711\t0.1807\t0.0
A2 \t-0.3\t0.0007\t593.2\t 0.02
A3\t-0.4\t0.0002\t-597.6\t0.01
A4\t\t0.0\t1.5709\t4.5743\t0.0
A5 0.0 -1.5706 0.1198 0.0
A6\t0.0\t0.0\t0.1159\t0.0\t
"""


def test_far_d_that_cancel_tabs_and_blanks(tmp_path: Path) -> None:
    (tmp_path / "arm.csv").write_text(CALIBRATED)
    assert new(tmp_path, "--dh", str(tmp_path / "arm.csv")).endswith(" 0")
    robot = load_robot(tmp_path / "arm")
    assert np.abs(robot.facts.placements[:, :3, 3]).max() < 1.0
    rows = np.array([line.split()[1:] for line in CALIBRATED.splitlines()[1:]], dtype=float)
    textbook = np.column_stack([1e3 * rows[:, 0], np.rad2deg(rows[:, 1]), 1e3 * rows[:, 2], np.rad2deg(rows[:, 3])])
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (20, 6))
    wanted = np.stack([product(textbook, angles, False) for angles in q])
    np.testing.assert_allclose(reference_flange(robot, q), wanted, rtol=0, atol=1e-11)
    (tmp_path / "arm.csv").write_text(CALIBRATED.replace("d_m", "d_mm").replace("593.2", "593200"))
    (tmp_path / "arm").rename(tmp_path / "first")
    said = new(tmp_path, "--dh", str(tmp_path / "arm.csv"))
    assert "line 3: joint 'A2' leads 592.607 m away: no arm has such a link" in said


def test_axes_along_gravity_but_for_rounding_carry_no_weight(tmp_path: Path) -> None:
    """A SCARA whose quill turns upside down."""
    (tmp_path / "arm.csv").write_text("a_mm,alpha_deg,d_mm,theta_deg\n400,0,220,0\n250,180,0,0\n0,0,100,0\n")
    said = new(tmp_path, "--dh", str(tmp_path / "arm.csv"), "--payload", "3")
    assert "no joint carries any weight: all axes are along gravity" in said
    assert said.endswith(" 0")


def test_zeros_signs_and_the_first_bearing_of_a_table_are_asked(tmp_path: Path) -> None:
    table = "joint,a_mm,alpha_deg,d_mm,theta_deg\nA1,500,-90,1045,0\nA2,1300,0,0,0\nA3,-55,90,0,-90\nA4,0,-90,-1025,0\n"
    (tmp_path / "arm.csv").write_text(table)
    said = new(tmp_path, "--dh", str(tmp_path / "arm.csv"))
    assert "the flange stands at x 2825, y 0, z 990 mm of the base and its z points along +y" in said
    assert "anticlockwise: A1 +z, A2 +y, A3 +y, A4 -x; do the manual's arrows?" in said
    assert "bearing: a tilt of A1 is taken about its frame, 0 m above the base" in said
    (tmp_path / "arm").rename(tmp_path / "floor")
    said = new(tmp_path, "--dh", str(tmp_path / "arm.csv"), "--bearing", "0.4")
    assert "bearing:" not in said
    robot, other = load_robot(tmp_path / "arm"), load_robot(tmp_path / "floor")
    assert robot.facts.bearings[0] == pytest.approx(0.4)
    assert not any(other.facts.bearings)
    q = np.random.default_rng(0).uniform(-1, 1, (5, 4))
    np.testing.assert_allclose(reference_flange(robot, q), reference_flange(other, q), atol=1e-12)


def test_proposed_compliances_and_masses_are_those_of_such_arms(root: Path) -> None:
    """Within a factor of 2 of every shipped arm, whose masses the file states or does not (2.2: two wrists)."""
    for folder in sorted(path.parent for path in (root / "robots").glob("*/robot.yaml") if "kl4000" not in str(path)):
        robot, spec = load_robot(folder), (folder / "robot.yaml").read_text()
        file, base, flange = (re.findall(rf'^{key}: "?([^"\n]*)', spec, re.M)[0] for key in ("urdf", "base", "flange"))
        urdf = read_urdf(folder / file, folder)
        bare = replace(urdf, links=tuple(replace(link, inertial=None) for link in urdf.links))
        for source, most in ((urdf, 2.0), (bare, 2.2)):
            made = propose("arm", source, base, flange, payload=robot.payload)
            masses = [float(m) for m in re.findall(r'<mass value="([^"]+)"', made.files["arm.urdf"])]
            assert 1 / most < sum(masses) / robot.facts.masses.sum() < most, folder.name
            stated = {p.name: p.nominal for p in robot.parameters}
            for name, value in re.findall(r'^"(.*)":\n  value_urad/\(N m\): (\S+)', made.files["nominal.yaml"], re.M):
                if name in stated:
                    assert 1 / most < 1e-6 * float(value) / stated[name] < most, (folder.name, name)
