"""Points of an ACME tracker: `POINT name x y z`, after a line with the unit."""

from qsframework.plugin import InputError, MeasuredFile, PointTable, Problem


def read(file: MeasuredFile) -> PointTable | None:
    """The points of a file that begins with `ACME TRACKER`; None of all others."""
    lines = file.text.splitlines()
    if not lines or lines[0].strip() != "ACME TRACKER":
        return None
    unit, rows = "", []
    for number, line in enumerate(lines, start=1):
        word, *cells = line.split() or [""]
        if word == "UNIT" and cells:
            unit = cells[0]
        elif word == "POINT" and len(cells) == 4:
            rows.append((number, tuple(cells)))
        elif word == "POINT":
            allowed = "a name and three numbers"
            raise InputError(Problem("a point", str(file.path), number, found=line.strip(), allowed=allowed))
    if not unit or not rows:
        raise InputError(Problem("holds no unit or no points", str(file.path), allowed="UNIT mm, POINT name x y z"))
    return PointTable("points of an ACME tracker", ("name", *(f"{axis} [{unit}]" for axis in "xyz")), tuple(rows))
