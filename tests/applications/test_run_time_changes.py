"""Points, frames and paths that a programme changes when it runs: refused with line and reason; reading is free."""

from __future__ import annotations

from pathlib import Path

import pytest

from qsframework.plugin.language import read_source

KRL = "DEF drill( )\nPTP XP1\n{}\nLIN XP2\n{}END\n"
KRL_DAT = """DEFDAT drill
DECL E6POS XP1={X 1800.0,Y 300.0,Z 1500.0,A 0.0,B 90.0,C 0.0}
DECL E6POS XP2={X 1800.0,Y 100.0,Z 1500.0,A 0.0,B 90.0,C 0.0}
DECL FDAT FP1={TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE}
DECL FDAT FP2={TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE}
ENDDAT
"""
SHIFT = "END\nDEF SHIFT(P:{})\nDECL E6POS P\n{}\n"
TARGET = "[[1800,{},1500],[0.5,0,0.8660254,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
RAPID = (
    "MODULE drill\nPERS tooldata t1:=[TRUE,[[0,0,200],[1,0,0,0]],[50,[0,0,100],[1,0,0,0],0,0,0]];\n"
    f"PERS robtarget p1:={TARGET.format(300)}PERS robtarget p2:={TARGET.format(100)}"
    "PROC main()\nMoveJ p1,v100,fine,t1;\n{}\nMoveL p2,v100,fine,t1;\nENDPROC\n{}ENDMODULE\n"
)
SCRIPT = "def drill():\n  movej([0.1,-1.2,1.3,0.1,1.2,0.1])\n  {}\n  movej([0.2,-1.2,1.3,0.1,1.2,0.1])\nend\n"
LS = """/PROG  DRILL
/ATTR
/APPL
/MN
   1:J P[1] 20% FINE    ;
   2:  {} ;
   3:L P[2] 250mm/sec FINE    ;
   4:  {} ;
/POS
P[1]{{
   GP1:
\tUF : 2, UT : 3,
\tX = 1 mm, Y = 2 mm, Z = 3 mm, W = 0 deg, P = 0 deg, R = 0 deg
}};
P[2]{{
   GP1:
\tUF : 2, UT : 3,
\tX = 1 mm, Y = 9 mm, Z = 3 mm, W = 0 deg, P = 0 deg, R = 0 deg
}};
/END
"""


def refused(folder: Path, ending: str, text: str) -> dict[int, str]:
    """Which motion, by its number from 1, is refused for what."""
    (folder / f"drill{ending}").write_text(text)
    if ending == ".src":
        (folder / "drill.dat").write_text(KRL_DAT)
    source = read_source(folder / f"drill{ending}")
    wrong = {p.name: p.problem.message for p in source.points if p.problem}
    wrong |= {p.name: "not the same on every way" for p in source.points if "?" in (p.tool, p.frame)}
    said = {
        k: [m.problem.message] if m.problem else [wrong[name] for name in m.points if name in wrong]
        for k, m in enumerate(source.motions, start=1)
    }
    return {k: own[0] for k, own in said.items() if own}


CHANGED = {
    "XP2.Z=1600": "XP2 gets its value in line 3",
    "SEARCHEXT(XP2,5)": "XP2 is given to SEARCHEXT in line 3, which may change it",
    "B=MYFUNC(XP2)": "given to MYFUNC",
    "IF MYFUNC(5,XP2.X) THEN": "given to MYFUNC",
    "IF MYFUNC(XP2) THEN LIN XP1": "given to MYFUNC",
    "TRIGGER WHEN PATH=10 DELAY=0 DO XP2.Z=1600": "in line 3",
    "TRIGGER WHEN DISTANCE=0 DELAY=20 DO MEND(XP2) PRIO=-1": "given to MEND",
    "INTERRUPT DECL 3 WHEN $IN[1] DO XP2.Z=1600": "in line 3",
    "GLOBAL INTERRUPT DECL 3 WHEN $IN[1] DO XP2=XP1": "in line 3",
    "INTERRUPT DECL 3 WHEN $IN[1] DO MEND(XP2)": "given to MEND",
    "FOR XP2.Z=1000 TO 1500 STEP 100": "in line 3",
    "IF $IN[1] THEN XP2.Z=1600": "in line 3",
    "ANIN ON XP2.Z=0.5*$ANIN1+2": "in line 3",
    'CREAD(H,S,M,T,O,"%f",XP2.Z)': "given to CREAD",
    'SREAD(TEXT[],S,O,"%f",XP2.Z)': "given to SREAD",
    "RSI_MOVECORR()": "RSI_MOVECORR in line 3 shifts the path",
    "RET=RSI_ON(#RELATIVE)": "RSI_ON in line 3 shifts the path",
    "ST_ON(1,2)": "ST_ON in line 3",
    "$TECH.MODE=#CYCLE": "$TECH in line 3",
    "MEND($BASE)": "not the same on every way",
    "TRIGGER WHEN PATH=10 DELAY=0 DO $BASE=BASE_DATA[2]": "not the same on every way",
    "SET_TORQUE_LIMITS(1,LIMITS)": "SET_TORQUE_LIMITS in line 3",
    "FOR $TOOL.Z=100 TO 300 STEP 100": "not the same on every way",
    "FP2.BASE_NO=NUMBER": "not the same on every way",
    "MEND(FP2)": "not the same on every way",
}


@pytest.mark.parametrize("line", CHANGED)
def test_krl_changes_the_second_point(line: str, tmp_path: Path) -> None:
    found, last = refused(tmp_path, ".src", KRL.format(line, "")), 2 + ("LIN XP1" in line)
    assert list(found) == [last]
    assert CHANGED[line] in found[last]


@pytest.mark.parametrize(
    "line", ["BASE_DATA[0].X=50", "TOOL_DATA[1]=TOOL_DATA[2]", "BASE_DATA[I].Z=1", "MEND(TOOL_DATA[1])", "$ROBROOT.X=1"]
)
def test_krl_changes_the_data_of_a_frame(line: str, tmp_path: Path) -> None:
    found = refused(tmp_path, ".src", KRL.format(line, ""))
    assert list(found) == [1, 2]
    assert "in line 3" in found[1]


@pytest.mark.parametrize(
    "line",
    [
        "R=XP2.Z+ABS(XP2.X)",
        "A1=INVERSE(XP2,XP1,N)",
        'CWRITE(H,S,M,"%f",XP2.Z)',
        "IF (XP2.Z>3) AND (N==2) THEN",
        "XP3=XP2",
        "BASE_DATA[5].X=50",
        "TOOL_DATA[2]=TOOL_DATA[1]",
        "GRIPPER(1)",
        "RSI_OFF()",
        "INTERRUPT DECL 3 WHEN $IN[1] DO STOPPED()",
        "TRIGGER WHEN PATH=10 DELAY=0 DO $OUT[1]=TRUE",
        "FOR I=1 TO 3",
    ],
)
def test_krl_only_reads(line: str, tmp_path: Path) -> None:
    assert refused(tmp_path, ".src", KRL.format(line, "")) == {}


@pytest.mark.parametrize(
    ("kind", "body", "changes"),
    [
        ("OUT", "P.Z=P.Z+100", True),
        ("OUT", "IF $IN[1] THEN\nP=XP1\nENDIF", True),
        ("OUT", "DEEPER(P)\nEND\nDEF DEEPER(Q:OUT)\nSHIFT(Q)\nQ.X=2", True),
        ("OUT", "ELSEWHERE(P)", True),
        ("OUT", "H=P.Z", False),
        ("OUT", "DEEPER(P)\nEND\nDEF DEEPER(Q:OUT)\nSHIFT(Q)", False),
        ("IN", "P.Z=P.Z+100", False),
        ("IN", "ELSEWHERE(P)", False),
    ],
)
def test_krl_looks_into_the_routines_of_the_file(kind: str, body: str, changes: bool, tmp_path: Path) -> None:
    text = KRL.format("SHIFT(XP2)", SHIFT.format(kind, body))
    assert list(refused(tmp_path, ".src", text)) == [2] * changes


def test_krl_knows_how_a_routine_of_another_file_is_declared(tmp_path: Path) -> None:
    for kind, motions in (("IN", []), ("OUT", [2])):
        text = KRL.replace("\n", f"\nEXT MEND(E6POS:{kind},INT:IN)\n", 1).format("MEND(XP2,3)", "")
        assert list(refused(tmp_path, ".src", text)) == motions


def test_krl_frames_and_corrections_of_routines_that_are_called(tmp_path: Path) -> None:
    inside = "END\nDEF ELSE_WHERE( )\n{}\n"
    for body, motions in (("$BASE=BASE_DATA[4]", [2]), ("RSI_ON(1)", [2]), ("BAS(#BASE,0)", []), ("$VEL.CP=1", [])):
        text = KRL.format("ELSE_WHERE( )", inside.format(body))
        assert list(refused(tmp_path, ".src", text)) == motions
    early = inside.format("IF $IN[1] THEN\nRETURN\nENDIF\nBAS(#BASE,0)")
    assert list(refused(tmp_path, ".src", KRL.format("BAS(#BASE,4)\nELSE_WHERE( )", early))) == [2]
    text = KRL.format("RSI_ON(1)\nGO( )\nRSI_OFF( )", "GO( )\nEND\nDEF GO( )\nLIN XP1\n")
    assert list(refused(tmp_path, ".src", text)) == [3]


def test_krl_tool_and_base_of_numbers(tmp_path: Path) -> None:
    """They hold, whatever is stored with the points."""
    text = KRL.replace("\n", "\n$BASE={{X 500,Y 0,Z 0,A 0,B 0,C 0}}\n$TOOL={{X 0,Y 0,Z 100,A 0,B 0,C 0}}\n", 1)
    (tmp_path / "drill.src").write_text(text.format("", ""))
    (tmp_path / "drill.dat").write_text(KRL_DAT)
    source = read_source(tmp_path / "drill.src")
    assert {p.tool for p in source.points} == {"{X 0,Y 0,Z 100,A 0,B 0,C 0}"} == set(source.tools)
    assert [place[0, 3] for place in source.frames.values()] == [0.5]


@pytest.mark.parametrize(
    "line",
    [
        "Incr p2.trans.z;",
        "Decr p2.trans.z;",
        "Add p2.trans.z,20;",
        "Clear p2.trans.z;",
        "ReadRawBytes raw,1\\Hex1,p2.trans.z\\Float4;",
        "elsewhere p2;",
        "elsewhere \\Quick,5,p2;",
        "elsewhere 5\\Place:=p2;",
        "IF di1=1 elsewhere p2;",
        "IF ready elsewhere p2;",
        "IF di1=1 THEN elsewhere p2; ENDIF",
        "TEST n CASE 1,2: Incr p2.trans.x; ENDTEST",
        'ok:=StrToVal("[1,2,3]",p2.trans);',
        'SetDataVal "p2",p1;',
        '%"elsewhere"+n%p2;',
        "SearchL di1,p2,p1,v20,t1;",
        "again: p2.trans.z:=5;",
        "ENDPROC PROC other() IF a(\\Q:=1) p2:=p1;",
    ],
)
def test_rapid_changes_the_second_point(line: str, tmp_path: Path) -> None:
    found = refused(tmp_path, ".mod", RAPID.replace("{}", line, 1).format(""))
    last = 3 if line.startswith("Search") else 2
    assert list(found) == [last]
    assert "p2" in found[last]
    assert "in line" in found[last]


@pytest.mark.parametrize(
    "line",
    [
        "WaitTime 0.5;",
        'TPWrite "at "\\Pos:=p2.trans;',
        "n:=Distance(p1.trans,p2.trans);",
        "p3:=Offs(p2,0,0,10);",
        "j:=CalcJointT(p2,t1);",
        "IF p2.trans.z>3 THEN TPWrite n; ENDIF",
        "RETURN p2;",
        "GripLoad load1;",
        "CorrCon c;",
        "PDispOn\\ExeP:=p2,p1,t1; PDispOff;",
        "SoftAct 3,20; SoftDeact;",
    ],
)
def test_rapid_only_reads(line: str, tmp_path: Path) -> None:
    assert refused(tmp_path, ".mod", RAPID.replace("{}", line, 1).format("")) == {}


@pytest.mark.parametrize(
    ("head", "body", "changes"),
    [
        ("INOUT robtarget p", "p.trans.z:=1600;", True),
        ("VAR robtarget p", "IF a p:=p1;", True),
        ("PERS robtarget p", "elsewhere p;", True),
        (
            "INOUT robtarget p",
            "deeper p; ENDPROC PROC deeper(\\num n,INOUT robtarget q) modify q; Incr q.trans.x;",
            True,
        ),
        ("INOUT robtarget p", "n:=p.trans.z;", False),
        ("robtarget p", "p.trans.z:=1600;", False),
        ("robtarget p", "elsewhere p;", False),
    ],
)
def test_rapid_looks_into_the_routines_of_the_module(head: str, body: str, changes: bool, tmp_path: Path) -> None:
    routine = f"PROC modify({head})\n{body}\nENDPROC\n"
    text = RAPID.replace("{}", "modify p2;", 1).replace("{}", routine)
    assert list(refused(tmp_path, ".mod", text)) == [2] * changes


def test_rapid_tools_and_displacements(tmp_path: Path) -> None:
    for line, routine, motions in (
        ("elsewhere t1;", "", [1, 2]),
        ("GripLoad load1;", "", []),
        ("shift;", "PROC shift() PDispSet pose1; ENDPROC\n", [2]),
        ("IF a PDispSet pose1;", "", [2]),
        ("PDispSet pose1; go; PDispOff;", "PROC go() MoveL p1,v9,fine,t1; ENDPROC\n", [3]),
        ("MoveL p1,v9,fine,t1\\Corr; MoveL p1,v9,fine,t1;", "", [2]),
        ("ArcL p1,v9,sm,wd\\Track:=tr,fine,t1;", "", [2]),
        ("SoftAct 3,20;", "", [2]),
    ):
        text = RAPID.replace("{}", line, 1).replace("{}", routine)
        assert list(refused(tmp_path, ".mod", text)) == motions, line


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("track_conveyor_linear([1,0,0,0,0,0],100,0)", r"relative to a conveyor"),
        ("track_conveyor_circular(c, 500, False, 0)", r"relative to a conveyor"),
        ("path_offset_set(p[0,0,0.1,0,0,0],2)", "a path offset shifts it when it runs"),
        ("path_offset_enable()", r"path_offset_enable in line 3"),
        ("force_mode(f,[0,0,1,0,0,0],w,2,l)", "gives way to forces"),
        ("freedrive_mode()", "gives way"),
        ("def go():\n    path_offset_enable()\n  end\n  go()", "in line 4"),
        ("if a:\n    force_mode(f,s,w,2,l)\n  end", "on one of the ways"),
        ("thread t():\n    path_offset_enable()\n  end\n  h = run t()", "on one of the ways"),
    ],
)
def test_urscript_shifts_the_second_motion(line: str, words: str, tmp_path: Path) -> None:
    found = refused(tmp_path, ".script", SCRIPT.format(line))
    assert list(found) == [2]
    assert words in found[2]


@pytest.mark.parametrize(
    "line",
    [
        "path_offset_set_max_offset(0.1, 0.1)",
        "force_mode(f,s,w,2,l)\n  end_force_mode()",
        "def go():\n    freedrive_mode()\n  end",
        "textmsg(q)",
    ],
)
def test_urscript_goes_to_its_points(line: str, tmp_path: Path) -> None:
    assert refused(tmp_path, ".script", SCRIPT.format(line)) == {}


@pytest.mark.parametrize(("line", "motions"), [("", []), ("p2[0] = 0.3", [2]), ("p3 = q", [2]), ("p2 = q", [2])])
def test_urscript_follows_a_copied_point(line: str, motions: list[int], tmp_path: Path) -> None:
    way = f"p2 = p[0.4,0.1,0.5,0,3.1,0]\n  p3 = p2\n  p4 = p3\n  movel(p4)\n  {line}"
    assert list(refused(tmp_path, ".script", SCRIPT.format(way))) == motions
    if not motions:
        assert read_source(tmp_path / "drill.script").motions[1].points == ("p2",)


def test_urscript_lists_and_routines(tmp_path: Path) -> None:
    way = "way = [[0.1,-1.2,1.3,0.1,1.2,0.1], [0.2,-1.2,1.3,0.1,1.2,0.1]]\n  {}movej(way[1])"
    for more, motions in (("way.append(q)\n  ", [2]), ("way[i][2] = 1.0\n  ", [2]), ("", [])):
        assert list(refused(tmp_path, ".script", SCRIPT.format(way.format(more)))) == motions
    go = "def go():\n    movej([0.1,-1.2,1.3,0.1,1.2,0.1])\n  end\n  {}go()\n  stop_conveyor_tracking()"
    for more, motions in (("track_conveyor_linear(d,1,0)\n  ", [2]), ("", [])):
        assert list(refused(tmp_path, ".script", SCRIPT.format(go.format(more)))) == motions


@pytest.mark.parametrize(
    ("line", "end", "motions"),
    [
        ("UFRAME[2]=PR[5]", "", [1, 2]),
        ("UTOOL[R[1]]=PR[5]", "", [1, 2]),
        ("$MNUFRAME[1,2]=PR[5]", "", [1, 2]),
        ("UFRAME[4]=PR[5]", "", []),
        ("PR[5]=UFRAME[2]", "", []),
        ("P[2]=LPOS", "", [2]),
        ("Touch Offset PR[3]", "Touch Offset End", [2]),
        ("Track TAST[1]", "Track End", [2]),
        ("SOFTFLOAT[1]", "SOFTFLOAT END", [2]),
        ("SOFTFLOAT[1]", "JMP LBL[1]", [1, 2]),
        ("WAIT 1.00(sec)", "JMP LBL[1]", []),
    ],
)
def test_fanuc(line: str, end: str, motions: list[int], tmp_path: Path) -> None:
    assert list(refused(tmp_path, ".ls", LS.format(line, end))) == motions
