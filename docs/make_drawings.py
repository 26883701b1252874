"""Draw the pages' line drawings: python docs/make_drawings.py writes docs/images/drawing-*.svg

A parallelogram and a balancer with the symbols of docs/model.md, what stands where on the measuring day, and four
terms of docs/glossary.md. All have a white ground: dark pages show them as light ones and paper do.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import atan2, cos, degrees, exp, hypot, radians, sin
from pathlib import Path

HERE = Path(__file__).resolve().parent
Point = tuple[float, float]
STYLE = """text { font: 15px sans-serif; fill: #222 } .sym { font-style: italic }
.link { stroke: #555; stroke-width: 12; stroke-linecap: round } .bar { stroke: #0072B2; stroke-width: 5 }
.thin { stroke: #222; stroke-width: 1; fill: none } .dash { stroke: #777; stroke-width: 1.2; stroke-dasharray: 5 4 }
.spring { stroke: #D55E00; stroke-width: 2.5; fill: none } .pivot { fill: #fff; stroke: #222; stroke-width: 2 }
.ground { fill: #ddd; stroke: #222 } .load { stroke: #D55E00; stroke-width: 3; fill: none } .mark { fill: #009E73 }
.wide { stroke: #D55E00; stroke-width: 2.5; stroke-dasharray: 9 5; fill: none } .read { fill: #0072B2 }
.narrow { stroke: #0072B2; stroke-width: 2.5; stroke-dasharray: 2 4; fill: none }
.after { stroke: #222; stroke-width: 3; fill: #ddd } .beam { stroke: #009E73; stroke-width: 2.5 }"""


def along(a: Point, angle: float, length: float) -> Point:
    """The point at a distance from another; angle in deg above the horizontal, y downwards as in SVG."""
    return a[0] + length * cos(radians(angle)), a[1] - length * sin(radians(angle))


def line(a: Point, b: Point, kind: str) -> str:
    return f'<line class="{kind}" x1="{a[0]:.1f}" y1="{a[1]:.1f}" x2="{b[0]:.1f}" y2="{b[1]:.1f}"/>'


def pivot(*points: Point) -> str:
    return "".join(f'<circle class="pivot" cx="{x:.1f}" cy="{y:.1f}" r="7"/>' for x, y in points)


def text(at: Point, words: str, kind: str = "") -> str:
    """Words; what follows _ in a symbol stands lower, as long as it is letters and digits."""
    name, _, low = words.partition("_") if kind == "sym" else (words, "", "")
    shown = f'{name}<tspan dy="4" font-size="11">{low}</tspan>' if low else name
    return f'<text class="{kind}" x="{at[0]:.1f}" y="{at[1]:.1f}">{shown}</text>'


def spring(a: Point, b: Point, coils: int = 9, width: float = 9.0) -> str:
    """A coil between two points."""
    n, turn = 2 * coils, atan2(b[1] - a[1], b[0] - a[0])
    length = hypot(b[0] - a[0], b[1] - a[1])
    path = [a]
    for i in range(1, n):
        u, v = length * (0.12 + 0.76 * i / n), width * (1 if i % 2 else -1)
        path.append((a[0] + u * cos(turn) - v * sin(turn), a[1] + u * sin(turn) + v * cos(turn)))
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in [*path, b])
    return f'<polyline class="spring" points="{points}"/>'


def arc(at: Point, radius: float, start: float, end: float) -> str:
    """An angle's arc, deg."""
    (x, y), (u, v) = along(at, start, radius), along(at, end, radius)
    return f'<path class="thin" d="M{x:.1f} {y:.1f} A{radius} {radius} 0 0 {int(end < start)} {u:.1f} {v:.1f}"/>'


def arrow(a: Point, b: Point, kind: str = "load") -> str:
    """A line with a head at its end."""
    back = degrees(atan2(b[1] - a[1], a[0] - b[0]))
    return "".join([line(a, b, kind), *(line(b, along(b, back + side, 13), kind) for side in (-28, 28))])


def parallelogram() -> list[str]:
    """Lever, bar and link 2 of one length and attitude each: the forearm keeps its attitude when link 2 turns."""
    shoulder, lever, q2, q3 = (150.0, 330.0), 70.0, 62.0, 14.0
    elbow = along(shoulder, q2, 210)
    heel, low = along(elbow, 180 + q3, lever), along(shoulder, 180 + q3, lever)
    wrist = along(elbow, q3, 260)
    return [
        f'<rect class="ground" x="{shoulder[0] - 45}" y="{shoulder[1]}" width="90" height="50"/>',
        line(shoulder, elbow, "link"),
        line(heel, wrist, "link"),
        line(low, shoulder, "bar"),
        line(low, heel, "bar"),
        line(shoulder, along(shoulder, 0, 110), "dash"),
        line(elbow, along(elbow, 0, 110), "dash"),
        arc(shoulder, 55, 0, q2),
        arc(elbow, 85, 0, q3),
        pivot(shoulder, elbow, heel, low, wrist),
        text((215, 305), "q_2", "sym"),
        text((340, 137), "q_3'", "sym"),
        text((215, 245), "l_2", "sym"),
        text((390, 90), "l_3", "sym"),
        text((28, 398), "lever, turned by motor 3"),
        text((82, 240), "bar"),
        text((206, 372), "motor 2 turns link 2"),
        text((420, 130), "forearm"),
    ]


def balancer() -> list[str]:
    """A spring between a pivot on the base and one on link 2: lengths lc, l2, s and the angle b of the model page."""
    joint, base, arm = (280.0, 330.0), 205.0, 75.0
    low, high = along(joint, base, 130), along(joint, arm, 150)
    return [
        f'<rect class="ground" x="{joint[0] - 180}" y="{joint[1] + 75}" width="300" height="26"/>',
        line(joint, along(joint, 270, 75), "link"),
        line(low, (low[0], joint[1] + 75), "link"),
        line(joint, along(joint, arm, 270), "link"),
        line(joint, low, "dash"),
        spring(low, high),
        arc(joint, 42, base, arm),
        pivot(joint, low, high),
        text((212, 378), "l_c", "sym"),
        text((312, 265), "l_2", "sym"),
        text((195, 255), "s", "sym"),
        text((268, 310), "b", "sym"),
        text((375, 120), "link 2"),
        text((300, 338), "joint 2"),
        text((55, 215), "spring or gas cylinder,"),
        text((55, 235), "force F = K_c (s - s_0)".replace("_c", "c").replace("_0", "0")),
    ]


def day() -> list[str]:
    """The tracker, its beams to the reflectors on the tool, and the weight below the load point."""
    base, tool = (150.0, 340.0), (420.0, 190.0)
    joints: Sequence[Point] = (base, (150.0, 280.0), (215.0, 130.0), (380.0, 150.0), tool)
    marks = ((400.0, 235.0), (452.0, 205.0), (448.0, 160.0))
    tracker = (640.0, 300.0)
    return [
        f'<rect class="ground" x="60" y="{base[1]}" width="640" height="16"/>',
        *(line(a, b, "link") for a, b in pairwise(joints)),
        *(line(tracker, m, "dash") for m in marks),
        pivot(*joints),
        *(f'<circle class="mark" cx="{x}" cy="{y}" r="7"/>' for x, y in marks),
        line(tracker, (tracker[0] - 30, base[1]), "thin"),
        line(tracker, (tracker[0] + 30, base[1]), "thin"),
        line(tracker, (tracker[0], base[1]), "thin"),
        f'<rect class="pivot" x="{tracker[0] - 14}" y="{tracker[1] - 34}" width="28" height="36" rx="6"/>',
        arrow(tool, (tool[0], 308)),
        arrow((base[0], base[1]), (base[0] + 60, base[1]), "thin"),
        arrow((base[0], base[1]), (base[0], base[1] - 52), "thin"),
        text((598, 252), "laser tracker"),
        text((468, 150), "reflectors, on the tool"),
        text((290, 270), "load: a weight"),
        text((290, 290), "at the load point"),
        text((70, 382), "base frame: x ahead, z up"),
        text((400, 382), "read every reflector unloaded, then loaded"),
    ]


def _leaning(foot: float, keeps: bool, said: Sequence[str]) -> list[str]:
    """An arm before (dashed) and after J2 alone has turned by 20 deg; keeps: the forearm keeps its attitude."""
    shoulder = (foot, 230.0)
    parts = [f'<rect class="ground" x="{foot - 45}" y="230" width="90" height="40"/>']
    for lean, kind in ((0.0, "dash"), (20.0, "link")):
        elbow = along(shoulder, 90 - lean, 190)
        wrist = along(elbow, 0 if keeps else -lean, 170)
        parts += [line(shoulder, elbow, kind), line(elbow, wrist, kind)]
        if kind == "link":
            parts.append(pivot(shoulder, elbow, wrist))
    parts.append(arc(shoulder, 95, 90, 70))
    parts.append(text((foot - 56, 130), "20 deg"))
    return [*parts, *(text((foot - 55, 295 + 20 * k), words) for k, words in enumerate(said))]


def third_angle() -> list[str]:
    """J2 alone has turned by 20 deg, J3 reads what it read: left the angle between the links, right the elevation."""
    relative = ("The forearm turns along:", "J3 is the angle between the links,", "nothing is to do")
    elevation = (
        "The forearm keeps its attitude:",
        "J3 is its elevation, equals: J3 - J2",
        "(axes alike) or J3 + J2 (opposed)",
    )
    return [*_leaning(100.0, False, relative), *_leaning(440.0, True, elevation)]


def zero_angles() -> list[str]:
    """At zero joint angles, seen along the driver's axis, which points at the reader: angles grow to the left."""
    shoulder, lever = (260.0, 260.0), 90.0
    elbow = along(shoulder, 90, 200)
    low, heel = along(shoulder, 0, lever), along(elbow, 0, lever)
    base, arm = along(shoulder, 205, 120), along(shoulder, 90, 120)
    return [
        f'<rect class="ground" x="{shoulder[0] - 45}" y="{shoulder[1]}" width="90" height="45"/>',
        line(shoulder, elbow, "link"),
        line(elbow, along(elbow, 180, 190), "link"),
        line(elbow, heel, "link"),
        line(shoulder, low, "bar"),
        line(low, heel, "bar"),
        line(shoulder, base, "dash"),
        spring(base, along(arm, 180, 12)),
        line(arm, along(arm, 180, 12), "bar"),
        arc(shoulder, 50, 0, 90),
        arc(shoulder, 34, 90, 205),
        pivot(shoulder, elbow, low, heel, base, along(arm, 180, 12)),
        text((362, 222), "zero_deg: -90"),
        text((362, 252), "lever_m: from axis 2 to the bar,"),
        text((362, 272), "and from axis 3 to the bar"),
        text((275, 125), "link 2"),
        text((80, 48), "forearm"),
        text((20, 118), "l2_m: from axis 2 to the"),
        text((20, 138), "balancer's pivot on link 2"),
        text((20, 345), "lc_m: from axis 2 to its pivot on the link before"),
        text((75, 285), "zero_deg:"),
        text((75, 305), "-115"),
        text((20, 385), "Seen with axis 2 towards you, angles count to the left: of a parallelogram from link 2"),
        text((20, 405), "to the lever, of a balancer from lc to l2, whose angle grows with the joint's."),
    ]


def dots(points: Sequence[Point], kind: str, radius: float) -> str:
    return "".join(f'<circle class="{kind}" cx="{x:.1f}" cy="{y:.1f}" r="{radius:g}"/>' for x, y in points)


def _from_above(axis: Point, turn: float, said: Sequence[str]) -> list[str]:
    """An arm from above and its tracker, both turned about axis 1 by an angle in deg."""
    elbow = along(axis, 100 + turn, 85)
    tool = along(elbow, 45 + turn, 70)
    marks = [along(tool, angle + turn, 24) for angle in (100, 45, -10)]
    tracker = along(axis, 20 + turn, 150)
    return [
        *(line(tracker, m, "beam") for m in marks),
        line(axis, elbow, "link"),
        line(elbow, tool, "link"),
        dots([axis], "ground", 18),
        pivot(axis, elbow),
        dots(marks, "mark", 7),
        *(arrow(tracker, along(tracker, angle + turn, 38), "thin") for angle in (0, 90)),
        f'<rect class="pivot" x="{tracker[0] - 9:.1f}" y="{tracker[1] - 9:.1f}" width="18" height="18" rx="4"/>',
        *(text((axis[0] - 28, axis[1] + 42 + 20 * k), words) for k, words in enumerate(said)),
    ]


def gauge_freedom() -> list[str]:
    """Seen from above: the zero of joint 1 and the tracker's frame are off by one angle, and every beam is the same."""
    right, off = (50.0, 200.0), (305.0, 200.0)
    return [
        *_from_above(right, 0.0, ("zero of joint 1: right,", "tracker's frame: right")),
        *_from_above(off, 18.0, ("zero of joint 1: 18 deg off,", "tracker's frame: 18 deg off")),
        line(off, along(off, 100, 85), "dash"),
        text((112, 42), "reflectors"),
        text((150, 182), "tracker, its frame"),
        text((20, 292), "In the tracker's frame every beam is the same:"),
        text((20, 312), "no reading shows that anything is off."),
    ]


def _bell(kind: str, mean: float, sd: float, closed: bool = False) -> str:
    """A normal density: 34 px a unit, the axis at y = 250."""
    at = [mean + sd * k / 10 for k in range(-32, 33)]
    points = [(240 + 34 * x, 250 - 330 * 0.3989 / sd * exp(-0.5 * ((x - mean) / sd) ** 2)) for x in at]
    shape = "polygon" if closed else "polyline"
    listed = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<{shape} class="{kind}" points="{listed}"/>'


def prior() -> list[str]:
    """The prior's wide bell, that of the readings alone, and the narrowest one of both together, the posterior."""
    (m0, s0), (m1, s1) = (-0.8, 1.8), (1.8, 0.9)
    weight = (s0**-2, s1**-2)
    mean, sd = (m0 * weight[0] + m1 * weight[1]) / sum(weight), sum(weight) ** -0.5
    return [
        _bell("after", mean, sd, closed=True),
        _bell("wide", m0, s0),
        _bell("narrow", m1, s1),
        arrow((15, 250), (465, 250), "thin"),
        text((330, 272), "value of a parameter"),
        text((30, 130), "prior: what is known"),
        text((30, 150), "before the readings"),
        text((350, 150), "the readings"),
        text((350, 170), "alone"),
        text((190, 55), "posterior: both together"),
    ]


def _visit(foot: Point, shared: Point, name: str) -> list[str]:
    """Three markers of a tool: where the model puts them, and their reads, moved by the error of the visit."""
    places = [(foot[0], foot[1]), (foot[0] + 110, foot[1] + 30), (foot[0] + 40, foot[1] + 105)]
    own = ((-9, 3), (5, -8), (8, 7)), ((3, 9), (-8, -5), (9, -3)), ((-6, -7), (9, 1), (-3, 9))
    parts = [line(a, b, "dash") for a, b in zip(places, [*places[1:], places[0]], strict=True)]
    for (x, y), errors in zip(places, own, strict=True):
        to = (x + shared[0], y + shared[1])
        parts += [dots([(x, y)], "pivot", 7), arrow((x, y), to)]
        parts.append(dots([(to[0] + u, to[1] + v) for u, v in errors], "read", 3.5))
    return [*parts, text((foot[0] + 10, foot[1] - 45), name)]


def visit_and_read() -> list[str]:
    """Two visits of one pose: the markers of a visit share an error, and each read has one of its own."""
    return [
        *_visit((60.0, 80.0), (34.0, -16.0), "visit 1"),
        *_visit((300.0, 80.0), (-22.0, 26.0), "visit 2"),
        dots([(30.0, 246.0)], "pivot", 7),
        text((60, 251), "where the model puts a marker"),
        arrow((16.0, 276.0), (46.0, 270.0)),
        text((60, 279), "repeatability error: the same for all markers of a visit"),
        dots([(24.0, 302.0), (31.0, 297.0), (36.0, 305.0)], "read", 3.5),
        text((60, 307), "reads of one marker: each has its own error"),
    ]


def size() -> list[str]:
    """What an effect adds to the readings: one part the fitted parameters explain, the rest, in sds of noise, is s."""
    foot, unit = (90.0, 270.0), 26.0
    top = (330.0, foot[1] - 8 * unit)
    parts = [
        f'<circle class="ground" cx="{foot[0]}" cy="{foot[1]}" r="{unit}"/>',
        arrow(foot, (470.0, foot[1]), "thin"),
        line((foot[0], foot[1]), (foot[0], 30.0), "thin"),
        line((foot[0], top[1]), top, "dash"),
        line((top[0], foot[1]), top, "load"),
        arrow(foot, top, "beam"),
    ]
    for n, said in ((4, "s = 4"), (8, "s = 8")):
        y = foot[1] - n * unit
        parts += [line((foot[0] - 6, y), (foot[0] + 6, y), "thin"), text((foot[0] - 60, y + 5), said)]
    return [
        *parts,
        text((345, 150), "s: the part that"),
        text((345, 170), "no fit explains,"),
        text((345, 190), "in sds of noise"),
        text((130, 45), "what the effect adds to the readings"),
        text((130, 295), "what the fitted parameters can explain"),
        text((20, 320), "1 sd of the noise"),
        line((85.0, 305.0), (88.0, 288.0), "thin"),
    ]


DRAWINGS = {
    "third-angle": (third_angle, 720, 345),
    "zero-angles": (zero_angles, 670, 420),
    "parallelogram": (parallelogram, 540, 410),
    "balancer": (balancer, 480, 450),
    "day": (day, 740, 400),
    "gauge-freedom": (gauge_freedom, 480, 325),
    "prior": (prior, 480, 285),
    "visit-and-read": (visit_and_read, 480, 320),
    "size": (size, 480, 335),
}


def svg(name: str) -> str:
    """One drawing."""
    draw, width, height = DRAWINGS[name]
    said = " ".join((draw.__doc__ or "").split())
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" role="img">'
    paper = f'<rect width="{width}" height="{height}" fill="#fff"/>'
    return "\n".join([head, f"<title>{said}</title>", f"<style>{STYLE}</style>", paper, *draw(), "</svg>", ""])


if __name__ == "__main__":
    for drawing in DRAWINGS:
        (HERE / "images" / f"drawing-{drawing}.svg").write_text(svg(drawing))
