"""The table of `make coverage`: lines and branches of each package, and which must not fall below a share."""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

LEAST = 95.0
HELD = ("robot", "elastostatics", "plans", "fits", "diagnoses")
COUNTS = ("num_statements", "covered_lines", "num_branches", "covered_branches")


def packages(report: Mapping[str, Any]) -> dict[str, Counter[str]]:
    """Counts of each package of qsframework, from coverage's JSON."""
    out: dict[str, Counter[str]] = {}
    for file, found in report["files"].items():
        parts = Path(file).parts
        inside = parts[parts.index("qsframework") + 1 :]
        name = inside[0] if len(inside) > 1 else "(top)"
        out.setdefault(name, Counter()).update({key: found["summary"][key] for key in COUNTS})
    return out


def share(done: int, total: int) -> float:
    """Percent; all of nothing."""
    return 100.0 * done / total if total else 100.0


def shares(counts: Counter[str]) -> tuple[float, float, float]:
    """Percent of lines, of branches, and of both together."""
    lines, hit, branches, taken = (counts[key] for key in COUNTS)
    return share(hit, lines), share(taken, branches), share(hit + taken, lines + branches)


def table(report: Mapping[str, Any]) -> tuple[str, list[str]]:
    """The table, and what is wrong with it: packages below LEAST, or not there at all."""
    found = packages(report)
    lines = [f"{'package':<16}{'lines %':>10}{'branches %':>12}{'both %':>9}"]
    wrong = [f"{name}: not measured" for name in HELD if name not in found]
    for name in sorted(found):
        three = shares(found[name])
        mark = "" if name in HELD else "  (not held to anything)"
        lines.append(f"{name:<16}{three[0]:>10.1f}{three[1]:>12.1f}{three[2]:>9.1f}{mark}")
        if name in HELD and min(three[1:]) < LEAST:
            wrong.append(
                f"{name}: {three[1]:.1f} % of branches, {three[2]:.1f} % of lines and branches, below {LEAST:g}"
            )
    return "\n".join(lines), wrong


def main(path: str) -> int:
    """Print the table; 1 if a package is below its share."""
    text, wrong = table(json.loads(Path(path).read_text(encoding="utf-8")))
    print(text)
    print("\n".join(wrong), file=sys.stderr, end="\n" if wrong else "")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
