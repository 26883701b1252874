"""The four pictures of docs/results.md, from the tables in docs/records: python benchmarks/draw_records.py"""

from __future__ import annotations

import csv
from collections.abc import Callable

from common import RECORDS, ROOT

from qsframework.files import write_text

Row = dict[str, str]
SINGLE, RESULTS = "diagnosis-results-single-effects-by-size-by-s", "diagnosis-results-by-metric"
SECOND, UNKNOWN = "diagnosis-second-generator-by-metric", "diagnosis-unknown-kinds-untouched-kinds-by-metric"


def _percent(column: str) -> Callable[[Row], float]:
    return lambda row: float(row[column].split()[0])


PICTURES = {
    "detected": ("Single effects named right, by size s", SINGLE, "s", "", _percent("named right")),
    "alarms": ("Nothing hidden: false alarms, by noise", RESULTS, "metric", "false alarms, ", _percent("measured")),
    "second": ("Second generator, library effects", SECOND, "metric", "library effects, ", _percent("measured")),
    "unknown": ("Effects that no library holds", UNKNOWN, "metric", "untouched kinds: ", _percent("measured")),
}
"""By name: title, table, the column of labels, with what labels begin, the share drawn in percent."""


def bars(title: str, shares: dict[str, float]) -> str:
    """Horizontal bars from 0 to 100 %, as SVG; the text takes the colour of the page."""
    height = 44 + 26 * len(shares)
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 720 {height}" font-family="sans-serif" font-size="13">',
        f'<rect width="720" height="{height}" fill="#fff"/><text x="10" y="22" font-size="16">{title}</text>',
    ]
    for k, (label, share) in enumerate(shares.items()):
        y = 38 + 26 * k
        out.append(f'<text x="330" y="{y + 14}" text-anchor="end">{label}</text>')
        out.append(f'<rect x="340" y="{y}" width="{3.2 * max(share, 0.3):.1f}" height="18" fill="#0a6c74"/>')
        out.append(f'<text x="{346 + 3.2 * share:.1f}" y="{y + 14}">{share:g} %</text>')
    return "\n".join([*out, "</svg>"]) + "\n"


def pictures() -> dict[str, str]:
    """The four pictures by the names of their files."""
    out: dict[str, str] = {}
    for name, (title, table, column, start, share) in PICTURES.items():
        with (RECORDS / f"{table}.csv").open() as lines:
            rows = [row for row in csv.DictReader(lines) if row[column].startswith(start)]
        drawn = {row[column].removeprefix(start): share(row) for row in rows}
        prefix = "s = " if column == "s" else ""
        out[f"record-{name}.svg"] = bars(title, {prefix + label: value for label, value in drawn.items()})
    return out


def main() -> None:
    """Draw them."""
    for name, text in pictures().items():
        write_text(ROOT / "docs" / "images" / name, text)


if __name__ == "__main__":
    main()
