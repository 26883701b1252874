"""What the audit found about the readings, as an experiment's files can say it: noise, masked rows, sigmas."""

from __future__ import annotations

import csv
import io
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from qsframework import units
from qsframework.diagnoses.result import Diagnosis
from qsframework.experiment import NoiseModel
from qsframework.experiment.columns import number, quoted, table_lines, unquoted
from qsframework.experiment.noise import Source
from qsframework.experiment.readings import UNSTATED

_SAME = 1e-9


@dataclass(frozen=True)
class Audited:
    """What an audit changes.

    sigma: sd m of one coordinate of a reading, None where the experiment's own stands; of_position: whether it is of
    one position, in a file of states; masked: lines of the readings' file that the audit took out; factor: true over
    stated sigma of its rows; file: of each masked line, its place among several files, empty where there is one;
    source: where the size of the noise is from
    """

    sigma: float | None = None
    of_position: bool = False
    masked: tuple[int, ...] = ()
    factor: float = 1.0
    file: tuple[int, ...] = ()
    source: Source = "estimated"

    def of(self, file: int) -> Audited:
        """What concerns one of several files."""
        if not self.file:
            return self
        masked = tuple(m for m, k in zip(self.masked, self.file, strict=True) if k == file)
        return replace(self, masked=masked, file=())


def audited_of(diagnosis: Diagnosis) -> Audited:
    """What the audit of a diagnosis changes in its experiment and its readings."""
    audit, readings = diagnosis.audit, diagnosis.readings
    masked = tuple(int(r) for r in readings.line[diagnosis.outliers])
    several = len(readings.sources) > 1
    file = tuple(int(k) for k in readings.file[diagnosis.outliers]) if several else ()
    stated = diagnosis.experiment.noise
    if audit.unit_source == "stated" and (stated.sigma is not None or stated.apart):
        return Audited(masked=masked, file=file)
    noise = diagnosis.rms.noise
    states = bool(np.isfinite(readings.minus_sigma).any())  # differences of positions, whose sigma the file states
    given = readings.sigma[diagnosis.kept]
    if not readings.stated and np.all(given == UNSTATED):  # no row states any
        given = np.full(1, np.nan)
    own = np.sqrt(max(noise**2 - audit.shared**2, 0.0))
    factor = float(own / np.sqrt(np.mean(given**2)))
    factor = factor if np.isfinite(factor) else 1.0
    source = "repeats" if audit.unit_source == "replicates" else "estimated"
    return Audited(float(noise / np.sqrt(2.0)) if states else noise, states, masked, factor, file, source)


def noise_entry(stated: NoiseModel, audited: Audited) -> dict[str, float | str]:
    """`noise:` of an experiment as the audit found it, with its source; where each kind has its own, all of them by one
    factor."""
    found = stated.scaled(audited.factor, audited.source)
    if not stated.apart:
        found = replace(found, sigma=audited.sigma, repeatability=None)  # which that sd holds
    return found.entry()


def audited_readings(path: Path, audited: Audited) -> str | None:
    """The text of a readings file with rows masked and sigmas scaled, every line where it was; None if it is the same.

    path: of displacements or of states that have been read, so the table is known to be sound
    """
    lines = table_lines(path)
    filled = [i for i, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")]
    header, *rows = [[unquoted(cell) for cell in next(csv.reader([lines[i]]))] for i in filled]
    names = [name.strip() for name in header]
    scaled = [k for k, name in enumerate(names) if units.split(name, ["sigma"]) is not None]
    changes = scaled and abs(audited.factor - 1.0) > _SAME
    if not audited.masked and not changes:
        return None
    if "use" not in names:
        names, header, rows = [*names, "use"], [*header, "use"], [[*row, ""] for row in rows]
    use = names.index("use")
    lines[filled[0]] = _line(header)
    for i, row in zip(filled[1:], rows, strict=True):
        cells = _scaled(row, scaled if changes else (), audited.factor)
        cells[use] = "0" if i + 1 in audited.masked else cells[use].strip() or "1"
        lines[i] = _line(cells)
    return "\n".join(lines) + "\n"


def _scaled(row: Sequence[str], at: Collection[int], factor: float) -> list[str]:
    """The row with some numbers multiplied; empty cells and what a masked row may hold stay."""
    out = list(row)
    for k in at:
        try:
            out[k] = number(float(row[k]) * factor)
        except ValueError:
            continue
    return out


def _line(cells: Sequence[str]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="").writerow([quoted(cell) for cell in cells])
    return text.getvalue()
