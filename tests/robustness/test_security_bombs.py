"""Small files that would grow, and files that are large, endless or no files: refused in little memory and time."""

from __future__ import annotations

import os
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from limited import limited

from qsf_trackers.sheets import read_sheet
from qsframework.errors import InputError
from qsframework.experiment import (
    Experiment,
    example,
    load_experiment,
    read_plan,
    read_readings,
)
from qsframework.files import read_text, read_yaml
from qsframework.fits import read_fit
from qsframework.robot import load_robot

SMALL = Path(__file__).parent / "small"
HEADER = "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,fx_N,fy_N,fz_N,marker,dx_mm,dy_mm,dz_mm\n"
ROW = "1,0,90,-30,-45,30,35,0,0,-4000,m1,0.1,0.1,0.1\n"
XACRO = '<robot name="small" xmlns:xacro="http://www.ros.org/wiki/xacro">'


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    shutil.copytree(SMALL, tmp_path / "robot")
    return tmp_path / "robot"


def put(robot: Path, change: Callable[[str], str]) -> Path:
    """The robot with another URDF."""
    (robot / "small.urdf").write_text(change((robot / "small.urdf").read_text()))
    return robot


def in_xacro(text: str) -> Callable[[str], str]:
    return lambda urdf: urdf.replace('<robot name="small">', XACRO + text)


def laughs(levels: int = 40) -> str:
    entities = '<!ENTITY a0 "ha">' + "".join(f'<!ENTITY a{k + 1} "&a{k};&a{k};">' for k in range(levels))
    return f"<!DOCTYPE robot [{entities}]>"


def doubled(levels: int = 40) -> str:
    """Properties that double each other in an attribute."""
    more = "".join(f'<xacro:property name="p{k + 1}" value="${{p{k}}}${{p{k}}}"/>' for k in range(levels))
    return f'<xacro:property name="p0" value="haha"/>{more}<link name="${{p{levels}}}"/>'


def lists(levels: int = 40) -> str:
    more = "".join(f'<xacro:property name="p{k + 1}" value="${{[p{k}, p{k}]}}"/>' for k in range(levels))
    return f'<xacro:property name="p0" value="${{[1, 2]}}"/>{more}<link name="${{p{levels}}}"/>'


def blocks(levels: int = 40) -> str:
    more = "".join(
        f'<xacro:property name="b{k + 1}"><a><xacro:insert_block name="b{k}"/><xacro:insert_block name="b{k}"/></a>'
        "</xacro:property>"
        for k in range(levels)
    )
    return f'<xacro:property name="b0"><a/></xacro:property>{more}<xacro:insert_block name="b{levels}"/>'


def macros(levels: int = 40) -> str:
    more = "".join(f'<xacro:macro name="m{k + 1}"><xacro:m{k}/><xacro:m{k}/></xacro:macro>' for k in range(levels))
    return f'<xacro:macro name="m0"><a/></xacro:macro>{more}<xacro:m{levels}/>'


def comments() -> str:
    """A macro with a long comment, called often."""
    text = f'<xacro:macro name="m"><!--{"x" * 1_000_000}--></xacro:macro>'
    return text + "<xacro:m/>" * 5000


def expression(text: str) -> str:
    return f'<xacro:property name="p" value="{text}"/><link name="x${{p}}"/>'


URDF_BOMBS = {
    "billion laughs": (lambda urdf: laughs() + urdf.replace('name="small"', 'name="&a40;"'), "DOCTYPE"),
    "external entity": (
        lambda urdf: '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]>' + urdf.replace("small", "&x;", 1),
        "DOCTYPE",
    ),
    "external doctype": (lambda urdf: '<!DOCTYPE r SYSTEM "http://127.0.0.1:9/x.dtd">' + urdf, "DOCTYPE"),
    "parameter entity": (lambda urdf: '<!DOCTYPE r [<!ENTITY % x SYSTEM "/etc/passwd"> %x;]>' + urdf, "DOCTYPE"),
    "entities in xacro": (lambda urdf: laughs() + in_xacro('<link name="&a40;"/>')(urdf), "DOCTYPE"),
    "deep elements": (lambda urdf: "<robot>" + "<a>" * 400_000 + "</a>" * 400_000 + "</robot>", ""),
    "deep elements in xacro": (in_xacro("<a>" * 200_000 + "</a>" * 200_000), "nested too deeply"),
    "many elements": (in_xacro("<a/>" * 1_000_000), "more than 50000 elements"),
    "many attributes": (
        lambda urdf: urdf.replace("<link", "<link " + " ".join(f'a{k}="1"' for k in range(200_000)), 1),
        None,
    ),
    "doubled properties": (in_xacro(doubled()), "expands to more than"),
    "doubled lists": (in_xacro(lists()), "a list of more than"),
    "doubled blocks": (in_xacro(blocks()), "more than"),
    "doubled macros": (in_xacro(macros()), "more than"),
    "long comments in a macro": (in_xacro(comments()), "expands to more than"),
    "an expression of 10^6 terms": (in_xacro(expression("${1" + "+1" * 500_000 + "}")), "more than 20000 characters"),
    "10^5 expressions in a text": (in_xacro(expression("${1}" * 100_000)), "more than 20000 characters"),
    "a tower of powers": (in_xacro(expression("${9**9**9**9}")), "too large"),
    "a long factorial": (in_xacro(expression("${" + "*".join(["99999999"] * 1000) + "}")), None),
    "a shift": (in_xacro(expression("${1 &lt;&lt; 9999999999}")), "joins two numbers"),
    "a repeated text": (in_xacro(expression("${'a' * 10**12}")), "two numbers"),
    "a million digits": (in_xacro(expression("${" + "9" * 9000 + "}")), ""),
    "an endless macro": (in_xacro('<xacro:macro name="m"><xacro:m/></xacro:macro><xacro:m/>'), ""),
    "an endless property": (in_xacro('<xacro:property name="a" value="${a}1"/><link name="${a}"/>'), ""),
    "an endless include": (in_xacro('<xacro:include filename="small.urdf"/>'), "nested too deeply"),
}


@pytest.mark.parametrize("name", URDF_BOMBS)
def test_a_urdf_does_not_grow(robot: Path, name: str) -> None:
    change, words = URDF_BOMBS[name]
    put(robot, change)
    assert (robot / "small.urdf").stat().st_size < 6_000_000
    said = limited(lambda: load_robot(robot))
    assert said or words is None
    assert words is None or words in said.replace("Numerical result out of range", "too large"), said[:300]
    assert "root:" not in said


YAML_BOMBS = {
    "aliases": ("a: &a [x, x]\n" + "".join(f"b{k}: &b{k} [*a, *a]\n" for k in range(50)), "aliases"),
    "laughs": ("a0: &a0 ha\n" + "".join(f"a{k + 1}: &a{k + 1} [*a{k}, *a{k}]\n" for k in range(60)), "aliases"),
    "merge keys": ("a: &a {x: 1}\nb:\n  <<: *a\n", "aliases"),
    "python object": ("a: !!python/object/apply:os.system [id]\n", "tags are not allowed"),
    "python name": ("a: !!python/name:os.system\n", "tags are not allowed"),
    "brackets": ("a: " + "[" * 1_000_000, "nested too deeply"),
    "braces": ("a: " + "{a: " * 300_000, "nested too deeply"),
    "dashes": ("- " * 1_000_000, "nested too deeply"),
    "question marks": ("? " * 1_000_000, "nested too deeply"),
    "blocks": ("".join(" " * k + "a:\n" for k in range(2000)), "nested too deeply"),
    "values": ("a: [" + "1," * 1_500_000 + "1]\n", "more than 200000 values"),
    "keys": ("".join(f"k{k}: 1\n" for k in range(300_000)), "more than 200000 values"),
    "size": ("a: " + "x" * 6_000_000, "larger than 5 MB"),
    "digits": ("a: " + "9" * 4_000_000, ""),
}


@pytest.mark.parametrize("name", YAML_BOMBS)
def test_yaml_does_not_grow(robot: Path, name: str) -> None:
    text, words = YAML_BOMBS[name]
    for reader, file in ((load_robot, robot / "robot.yaml"), (read_fit, robot / "fit.json")):
        file.write_text(text)
        assert words in limited(lambda reader=reader, file=file: reader(file))


@pytest.fixture(scope="module")
def m900ib_small() -> Experiment:
    return load_experiment(example("m900ib") / "experiment.yaml")


def rows(path: Path, head: str, row: str, count: int) -> Path:
    """A table of many rows, written in blocks."""
    with path.open("w") as stream:
        stream.write(head)
        for _ in range(count // 10_000):
            stream.write(row * 10_000)
    return path


READERS: dict[str, Callable[[Path, Experiment], object]] = {
    "readings": read_readings,
    "plan": read_plan,
    "positions": lambda path, experiment: read_readings([path], experiment, "positions"),
}


@pytest.mark.parametrize("name", READERS)
def test_ten_million_rows_are_refused_before_they_are_taken_apart(
    m900ib_small: Experiment, tmp_path: Path, name: str
) -> None:
    short = rows(tmp_path / "short.csv", "a,b\n", "1,2\n", 10_000_000)
    assert short.stat().st_size == 40_000_004
    assert "more than 250000 lines" in limited(lambda: READERS[name](short, m900ib_small))
    short.unlink()
    long = tmp_path / "long.csv"
    long.write_text(HEADER)
    os.truncate(long, len(HEADER) + 10_000_000 * len(ROW))  # a sparse file: only its size counts
    assert "larger than 50 MB" in limited(lambda: READERS[name](long, m900ib_small), seconds=2.0, megabytes=20)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("," * 2_500_000 + "\n" + ROW, "is no table of ours"),
        (HEADER.strip() + "," * 2_500_000 + "\n" + ROW, "more than 1000 columns"),
        (HEADER + "," * 5_000_000 + "\n", "wrong number of columns"),
        ("pose," + "x" * 2_500_000 + "\n" + ROW, "is no table of ours"),
        (HEADER.strip() + ",marker" + "x" * 10_000_000 + "\n" + ROW, "larger than"),
        (HEADER + '"' + ROW * 5000, ""),
        (HEADER + "\r" * 40_000_000, "more than 250000 lines"),
        (HEADER + "\u2028" * 10_000_000, "more than 250000 lines"),
        ("# x\n" * 150_000 + HEADER + ROW, None),
        (HEADER + "# x\n" * 150_000, ""),
    ],
    ids=[
        "header",
        "columns",
        "row",
        "name",
        "long name",
        "quote",
        "carriage returns",
        "separators",
        "comments",
        "hidden rows",
    ],
)
def test_strange_tables_take_little(m900ib_small: Experiment, tmp_path: Path, text: str, words: str | None) -> None:
    path = tmp_path / "readings.csv"
    path.write_text(text, encoding="utf-8")
    said = limited(lambda: read_readings(path, m900ib_small), megabytes=300)
    assert words is None or (said and words.replace("larger than", "field larger than") in said), said[:300]


@pytest.mark.parametrize("cell", ["x", "1e9", "", "nan"])
def test_a_table_wrong_in_every_cell_is_told_shortly(m900ib_small: Experiment, tmp_path: Path, cell: str) -> None:
    row = ",".join([cell] * 14) + "\n"
    path = rows(tmp_path / "readings.csv", HEADER, row, 10_000)

    def read() -> None:
        with pytest.raises(InputError) as caught:
            read_readings(path, m900ib_small)
        assert 10 < len(caught.value.problems) < 20_000
        raise caught.value

    assert limited(read, seconds=20.0, megabytes=900)


def test_a_large_mesh_is_not_read(robot: Path) -> None:
    mesh = robot / "big.stl"
    mesh.touch()
    os.truncate(mesh, 100_000_000)
    visual = '<visual><geometry><mesh filename="big.stl"/></geometry></visual>'
    put(robot, lambda urdf: urdf.replace('<link name="tip"/>', f'<link name="tip">{visual}</link>'))
    assert "100 MB, more than 20" in limited(lambda: load_robot(robot), megabytes=60)


@pytest.mark.parametrize(
    ("name", "there"),
    [
        ("../x.stl", True),
        ("/etc/passwd", True),
        ("file:///etc/passwd", True),
        ("package://other/../../etc/passwd", False),
        ("http://127.0.0.1:9/x", False),
    ],
)
def test_meshes_from_elsewhere_are_neither_read_nor_copied(robot: Path, name: str, there: bool) -> None:
    from qsframework.robot.loader import robot_files

    (robot.parent / "x.stl").write_text("solid")
    visual = f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
    put(robot, lambda urdf: urdf.replace('<link name="tip"/>', f'<link name="tip">{visual}</link>'))
    if there:
        for read in (lambda: load_robot(robot), lambda: robot_files(robot / "robot.yaml")):
            with pytest.raises(InputError, match="lies outside the robot's folder and packages, and is not read"):
                read()
        return
    assert load_robot(robot).name == "small"
    assert [str(f) for f in robot_files(robot / "robot.yaml")] == ["small.urdf"]


OUTSIDE = ("../outside.urdf", "/etc/passwd", "linked.urdf", "way/outside.urdf", "file:///etc/passwd", "package://x/y")


@pytest.mark.parametrize("name", OUTSIDE)
@pytest.mark.parametrize("key", ["urdf", "nominal"])
def test_a_robots_files_stay_in_its_folder(robot: Path, key: str, name: str) -> None:
    shutil.copy(robot / "small.urdf", robot.parent / "outside.urdf")
    (robot / "linked.urdf").symlink_to(robot.parent / "outside.urdf")
    (robot / "way").symlink_to(robot.parent)
    text = (robot / "robot.yaml").read_text()
    old = {"urdf": "urdf: small.urdf", "nominal": "nominal: nominal.yaml"}[key]
    (robot / "robot.yaml").write_text(text.replace(old, f"{key}: {name}"))
    with pytest.raises(InputError, match=r"outside the robot's folder|does not exist"):
        load_robot(robot)


@pytest.mark.parametrize(
    "name", [*OUTSIDE, "$(find way)/outside.urdf", "$(find ..)/outside.urdf", "$(dirname)/../outside.urdf"]
)
def test_includes_stay_in_the_robots_folder(robot: Path, name: str) -> None:
    shutil.copy(robot / "small.urdf", robot.parent / "outside.urdf")
    (robot / "linked.urdf").symlink_to(robot.parent / "outside.urdf")
    (robot / "way").symlink_to(robot.parent)
    put(robot, in_xacro(f'<xacro:include filename="{name}"/>'))
    with pytest.raises(InputError) as caught:
        load_robot(robot)
    assert "root:" not in str(caught.value)
    assert "outside the robot's folder" in str(caught.value) or "no such file" in str(caught.value).lower()


def test_an_experiments_values_stay_in_its_folder(tmp_path: Path) -> None:
    shutil.copytree(example("m900ib"), tmp_path / "own")
    file = tmp_path / "own" / "experiment.yaml"
    (tmp_path / "values.yaml").write_text("a: {value: 1}\n")
    for name in ("../values.yaml", "/etc/passwd"):
        file.write_text((example("m900ib") / "experiment.yaml").read_text() + f"nominal: {name}\n")
        with pytest.raises(InputError, match="outside the experiment's folder"):
            load_experiment(file)


def everywhere(path: Path, experiment: Experiment) -> Iterator[Callable[[], object]]:
    """All readers, on one path."""
    yield lambda: load_robot(path)
    yield lambda: load_experiment(path)
    yield lambda: read_fit(path)
    yield lambda: read_readings(path, experiment)
    yield lambda: read_plan(path, experiment)
    yield lambda: read_readings([path, path], experiment)
    yield lambda: read_yaml(path)


@pytest.mark.parametrize(
    "kind", ["fifo", "folder", "device", "endless", "socket", "missing", "circle", "NUL in its name"]
)
def test_what_is_no_file_is_refused_at_once(m900ib_small: Experiment, tmp_path: Path, kind: str) -> None:
    path = tmp_path / "file.yaml"
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "socket":
        import socket

        with socket.socket(socket.AF_UNIX) as listening:
            listening.bind(str(path))
    elif kind == "circle":
        path.symlink_to(path)
    else:
        names = {"device": "/dev/null", "endless": "/dev/zero", "NUL in its name": str(path) + "\0"}
        path = Path(names.get(kind, str(path)))
    for read in everywhere(path, m900ib_small):
        assert limited(read, seconds=5.0, megabytes=50)


def test_what_cannot_be_read_is_refused_in_words() -> None:
    """Without the rights of root, under which the tests may run."""
    folder = Path(tempfile.mkdtemp())
    try:
        folder.chmod(0o755)
        secret = folder / "secret.yaml"
        secret.write_text("a: 1\n")
        secret.chmod(0)

        def read() -> object:
            if os.getuid() == 0:
                os.setgid(65534)
                os.setuid(65534)
            return read_text(secret)

        assert "cannot be read: Permission denied" in limited(read)
    finally:
        shutil.rmtree(folder)


ESCAPES = (
    "${().__class__.__bases__[0].__subclasses__()}",
    "${''.__class__}",
    "${[].append(1)}",
    "${__import__('os').system('id')}",
    "${open('/etc/passwd').read()}",
    "${eval('1')}",
    "${exec('1')}",
    "${globals()}",
    "${locals()}",
    "${vars()}",
    "${dir()}",
    "${getattr('', 'upper')()}",
    "${(lambda: 1)()}",
    "${[x for x in (1,)]}",
    "${{x: 1 for x in (1,)}}",
    "${(x := 1)}",
    "${f'{1}'}",
    "${'%c' % 65}",
    "${'{0.__class__}'.format(1)}",
    "${print(1)}",
    "${type(1)}",
    "${object}",
    "${help}",
    "${input()}",
    "${math.__loader__}",
    "${math.sin.__self__}",
    "${xacro.load_yaml('/etc/passwd')}",
    "${load_yaml('/etc/passwd')}",
    "${xacro.abs_filename('x')}",
    "${os.environ}",
    "${sys.exit()}",
    "${breakpoint()}",
    "${compile('1', '', 'eval')}",
    "${await_}",
    "${1 .__class__}",
    "${1 .real}",
    "${(1).bit_length()}",
    "${'a'.join(['b'])}",
    "${'a' if ().__len__ else 'b'}",
    "${max([1, 2], key=abs)}",
    "${sum(*[[1]])}",
    "${max(**{})}",
    "${python.open('/etc/passwd')}",
    "${python.eval('1')}",
    "$(eval 1+1)",
    "$(eval __import__('os').system('id'))",
    "$(env HOME)",
    "$(optenv HOME x)",
    "$(anon x)",
    "$(cwd x)",
    "$(shell id)",
    "$(find-pkg-share x)",
    "$(arg __class__)",
    "$(arg HOME)",
    "$${().__class__}${().__class__}",
)


@pytest.mark.parametrize("text", ESCAPES)
def test_expressions_reach_nothing_of_python(robot: Path, text: str) -> None:
    escaped = text.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    put(robot, in_xacro(f'<link name="l{escaped}"/>'))
    with pytest.raises(InputError) as caught:
        load_robot(robot)
    said = str(caught.value)
    assert any(words in said for words in ("xacro:", "has no default", "is outside the robot's packages"))
    assert "root:" not in said
    assert os.environ.get("HOME", "no home") not in said.replace(str(robot), "")


def workbook(path: Path, sheet: bytes, texts: bytes = b"") -> Path:
    """A workbook of one sheet with this XML, and of these shared texts."""
    import openpyxl

    openpyxl.Workbook().save(path)
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    space = b' xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main">'
    parts["xl/worksheets/sheet1.xml"] = b"<worksheet" + space + b"<sheetData>" + sheet + b"</sheetData></worksheet>"
    parts["xl/sharedStrings.xml"] = b"<sst" + space + texts + b"</sst>"
    kind = b"application/vnd.openxmlformats-officedocument.spreadsheetml.sharedStrings+xml"
    texts_are = b'<Override PartName="/xl/sharedStrings.xml" ContentType="' + kind + b'"/></Types>'
    parts["[Content_Types].xml"] = parts["[Content_Types].xml"].replace(b"</Types>", texts_are)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in parts.items():
            archive.writestr(name, content)
    return path


SHARED = b'<c t="s"><v>0</v></c>'
WORKBOOKS: dict[str, tuple[bytes, bytes, str]] = {
    "cells of one long text": ((b"<row>" + SHARED * 10 + b"</row>") * 60, b"A" * 4_999_000, "is larger than that"),
    "many cells of a long text": ((b"<row>" + SHARED * 99 + b"</row>") * 99, b"A" * 32_000, "is larger than that"),
    "a long text of its own": (
        b'<row><c t="inlineStr"><is><t>' + b"A" * 9_000_000 + b"</t></is></c></row>",
        b"",
        "is larg",
    ),
    "empty cells": ((b"<row>" + b"<c/>" * 900 + b"</row>") * 2000, b"", "is larger than that"),
    "a row far away": (b'<row r="1000000"><c><v>1</v></c></row>', b"", "is larger than that"),
    "a column far away": (b'<row><c r="XFD1"><v>1</v></c></row>' * 9, b"", "is larger than that"),
    "more than it may unpack to": (b"<row/>" * 9_000_000, b"", "unpacks to more than 50 MB"),
}


@pytest.mark.parametrize("name", WORKBOOKS)
def test_workbooks_are_bounded_by_what_they_unfold_to(tmp_path: Path, name: str) -> None:
    sheet, text, said = WORKBOOKS[name]
    path = workbook(tmp_path / "points.xlsx", sheet, b"<si><t>" + text + b"</t></si>" if text else b"")
    assert said in limited(lambda: read_sheet(path), seconds=15.0, megabytes=200)
