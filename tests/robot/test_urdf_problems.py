"""Every broken URDF is refused with the file, the line and what is wrong."""

from __future__ import annotations

import pytest

from qsframework.robot.xml_tree import quoted

CASES = {
    "negative mass": (('value="5"', 'value="-5"'), '<mass value="-5"', ("'fore'", "positive mass", "-5 kg")),
    "zero mass": (('value="5"', 'value="0"'), '<mass value="0"', ("'fore'", "positive mass")),
    "mass is text": (('value="5"', 'value="heavy"'), "heavy", ("'fore'", "value of <mass>", "'heavy'")),
    "mass is nan": (('value="5"', 'value="nan"'), "nan", ("finite number",)),
    "centre of mass in cm": (('xyz="0.4 0 0"', 'xyz="40 0 0"'), '<mass value="5"', ("'fore'", "40 m", "in metres")),
    "centre of mass in mm": (('xyz="0.4 0 0"', 'xyz="400 0 0"'), 'xyz="400', ("'fore'", "up to 100 m", "in metres")),
    "mass in g": (('<mass value="5"', '<mass value="5000000"'), '<mass value="5000000"', ("no mass", "up to 50000 kg")),
    "mass in digits of another script": (
        ('<mass value="5"', '<mass value="\N{ARABIC-INDIC DIGIT FIVE}"'),
        '<mass value="\N{ARABIC-INDIC DIGIT FIVE}"',
        ("must be a finite number",),
    ),
    "inertia not positive": (('ixx="0.2"', 'ixx="-0.2"'), 'ixx="-0.2"', ("'fore'", "not positive definite")),
    "inertia by products": (
        ('ixx="0.2" iyy="0.6" izz="0.6" ixy="0"', 'ixx="0.2" iyy="0.6" izz="0.6" ixy="0.5"'),
        'ixy="0.5"',
        ("not positive definite",),
    ),
    "triangle": (('ixx="0.2"', 'ixx="2.0"'), 'ixx="2.0"', ("'fore'", "triangle inequality", "2 kg m2")),
    "inertia incomplete": (('izz="0.6"', ""), 'ixx="0.2"', ("<inertia> has no izz",)),
    "unknown parent": (
        ('<parent link="upper"', '<parent link="uper"'),
        'joint name="elbow"',
        ("unknown parent link 'uper'", "Did you mean 'upper'?"),
    ),
    "unknown child": (
        ('<child link="tip"', '<child link="tipp"'),
        'joint name="mount"',
        ("unknown child link 'tipp'", "'tip'"),
    ),
    "no child": (('<child link="tip"/>', ""), 'joint name="mount"', ("'mount' has no child link",)),
    "no limits": (
        ('<limit lower="-3" upper="3" effort="0" velocity="0"/>', ""),
        'joint name="elbow"',
        ("'elbow' has no limits",),
    ),
    "an effort alone": (('lower="-3" upper="3"', ""), 'joint name="elbow"', ("'elbow' has no limits",)),
    "limits swapped": (
        ('lower="-3" upper="3"', 'lower="3" upper="-3"'),
        'joint name="elbow"',
        ("below the upper", "3 .. -3"),
    ),
    "zero axis": (('xyz="0 -1 0"', 'xyz="0 0 0"'), 'joint name="elbow"', ("no direction",)),
    "two numbers": (('xyz="0.8 0 0"', 'xyz="0.8 0"'), 'xyz="0.8 0"', ("'mount'", "3 finite numbers")),
    "unknown type": (
        ('name="elbow" type="revolute"', 'name="elbow" type="revolut"'),
        'name="elbow"',
        ("unknown type", "Did you mean 'revolute'?"),
    ),
    "planar": (
        ('name="elbow" type="revolute"', 'name="elbow" type="planar"'),
        'name="elbow"',
        ("not supported yet",),
    ),
    "mimic of nothing": (
        ('<axis xyz="0 -1 0"/>', '<axis xyz="0 -1 0"/><mimic joint="shoulde"/>'),
        'joint name="elbow"',
        ("mimics the unknown joint 'shoulde'", "'shoulder'"),
    ),
    "mimic": (
        ('<axis xyz="0 -1 0"/>', '<axis xyz="0 -1 0"/><mimic joint="shoulder"/>'),
        'joint name="elbow"',
        ("'elbow' follows 'shoulder' by mimic", "follows: {shoulder: 1}", "out of controller"),
    ),
    "joint twice": (
        ('name="elbow"', 'name="shoulder"'),
        '<parent link="upper"',
        ("joint 'shoulder' stands here again",),
    ),
    "link without name": (('<link name="tip"/>', '<link name="tip"/><link/>'), "<link/>", ("a link has no name",)),
    "doctype": (("<robot", '<!DOCTYPE robot [<!ENTITY a "a">]>\n<robot'), "DOCTYPE", ("DOCTYPE", "not allowed")),
    "mismatched tag": (("</joint>\n</robot>", "</robot>"), "</robot>", ("not well-formed XML", "mismatched tag")),
    "not a robot": (('<robot name="small">', '<sdf name="small">'), "<sdf", ("must be <robot>",)),
    "flat solid": (('size="0.1 0.2 1.0"', 'size="0.1 0 1.0"'), "0.1 0 1.0", ("positive sizes",)),
}


@pytest.mark.parametrize("name", CASES)
def test_each_problem_is_told_with_its_line(small, told, name):
    change, where, words = CASES[name]
    small.edit("small.urdf", change)
    if name == "not a robot":
        small.edit("small.urdf", ("</robot>", "</sdf>"))
    problems = small.problems()
    line = small.line("small.urdf", where) - (name == "joint twice")
    assert any(p.line == line and all(word in str(p) for word in words) for p in problems), list(map(str, problems))
    assert all(p.file.endswith("small.urdf") or "robot.yaml" in p.file for p in problems)
    if name not in ("joint twice", "no child", "link without name", "mimic of nothing"):
        assert len(problems) == 1, list(map(str, problems))


def test_missing_inertial_of_a_moving_link(small, told):
    text = (small.folder / "small.urdf").read_text()
    start, stop = text.rindex("    <inertial>"), text.rindex("</inertial>") + len("</inertial>")
    small.write("small.urdf", text[:start] + text[stop:])
    told(
        small.problem(),
        "small.urdf",
        small.line("small.urdf", 'link name="fore"'),
        "'fore' moves but has no <inertial>",
    )


def test_a_fixed_link_may_carry_the_mass(small):
    text = (small.folder / "small.urdf").read_text()
    start, stop = text.rindex("    <inertial>"), text.rindex("</inertial>") + len("</inertial>")
    body = text[start:stop]
    text = (text[:start] + text[stop:]).replace('<link name="tip"/>', f'<link name="tip">{body}</link>')
    small.write("small.urdf", text)
    facts = small.load().facts
    assert facts.masses.tolist() == [0, 10, 5]
    assert facts.centres[2].tolist() == pytest.approx([1.2, 0, 0])


def test_link_with_two_parents(small, told):
    again = '<joint name="second" type="fixed"><parent link="base"/><child link="tip"/></joint>\n</robot>'
    small.edit("small.urdf", ("</robot>", again))
    told(
        small.problem(),
        "small.urdf",
        small.line("small.urdf", "second"),
        "'tip' has two parents",
        "'mount'",
        "'second'",
    )


def test_two_roots(small, told):
    small.edit("small.urdf", ("</robot>", '<link name="lost"/>\n</robot>'))
    told(small.problem(), "small.urdf", small.line("small.urdf", "lost"), "'lost' hangs on nothing", "'base'")


def test_circle(small, told):
    small.edit("small.urdf", ('<parent link="base"/>', '<parent link="tip"/>'))
    problem = small.problem()
    told(problem, "small.urdf", small.line("small.urdf", 'name="shoulder"'), "joints run in a circle")
    assert all(name in str(problem) for name in ("upper", "fore", "tip"))


def test_moving_joint_off_the_chain(small, told):
    mass = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
    ends = '<parent link="tip"/><child link="grip"/>'
    more = f'<link name="grip">{mass}</link>\n<joint name="finger" type="continuous">{ends}</joint>\n</robot>'
    small.edit("small.urdf", ("</robot>", more))
    told(
        small.problem(),
        "small.urdf",
        small.line("small.urdf", "finger"),
        "'finger' moves beside the arm",
        "coupling, joint: finger",
    )


def test_duplicate_link_names_its_first_line(small):
    small.edit("small.urdf", ("</robot>", '<link name="tip"/>\n</robot>'))
    first = small.line("small.urdf", '<link name="tip"/>')
    assert f"link 'tip' stands here again; it is also at line {first}" in str(small.problems()[0])


def test_all_problems_are_told_together(small):
    small.edit(
        "small.urdf",
        ('value="10"', 'value="-1"'),
        ('ixx="0.2"', 'ixx="9"'),
        ('<limit lower="-3" upper="3" effort="0" velocity="0"/>', ""),
        ('<parent link="fore"/>', '<parent link="for"/>'),
    )
    small.edit("robot.yaml", ("flange: tip", "flange: tips"), ("elbow: {", "ebow: {"), ("title", "titel"))
    text = "\n".join(map(str, small.problems()))
    for word in ("positive mass", "triangle", "no limits", "'for'", "titel", "'title' is missing"):
        assert word in text, text
    small.edit("robot.yaml", ("titel", "title"))
    text = "\n".join(map(str, small.problems()))
    for word in (
        "positive mass",
        "triangle",
        "no limits",
        "'for'",
        "no link 'tips'",
        "Did you mean 'tip'?",
        "no joint 'ebow'",
    ):
        assert word in text, text


@pytest.mark.parametrize("share", [0.05, 0.2, 0.4, 0.6, 0.8, 0.97])
def test_truncated(small, share):
    text = (small.folder / "small.urdf").read_text()
    small.write("small.urdf", text[: int(share * len(text))])
    problem = small.problem()
    assert "not well-formed XML" in problem.message
    assert problem.file.endswith("small.urdf")
    assert problem.line is not None


@pytest.mark.parametrize("text", ["", "   ", "\x00", "<", "<robot/>", "not xml", "<robot><link/></robot>"])
def test_no_urdf_at_all(small, text):
    small.write("small.urdf", text)
    assert all(p.file.endswith(("small.urdf", "robot.yaml")) for p in small.problems())


def test_not_utf8(small):
    (small.folder / "small.urdf").write_bytes(b"\xff\xfe<robot/>")
    assert "UTF-8" in str(small.problem())


def test_deep_nesting_ends_in_a_message(small):
    small.write("small.urdf", "<robot>" + "<a>" * 20000 + "</a>" * 20000 + "</robot>")
    assert small.problems()


def test_what_is_quoted_is_read_back_whole() -> None:
    """By the standard library's parser, for any characters that XML may hold."""
    from xml.etree.ElementTree import fromstring

    for value in ("plain", "a&b<c>d", "\"both\" 'kinds'", "tab\tline\nreturn\rend", "&amp; &#10; é 関節", ""):
        assert fromstring(f"<link name={quoted(value)}/>").attrib["name"] == value
