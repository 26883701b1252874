"""An import in words: what was taken for what, how the points lie to the arm, and the tracker's frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from qsf_trackers.importing import Imported
from qsf_trackers.layout import Sheet
from qsf_trackers.matching import TrackerPoint, label
from qsf_trackers.placing import Aligned
from qsf_trackers.tables import Listing, Taken
from qsframework.errors import some_of
from qsframework.report import ReportTable

_BY = {
    "header": "",
    "above": "as the text above says",
    "stated": "as stated",
    "cells": "as the cells say",
    "ros": "as ROS has it",
    "rtde": "as RTDE has it",
    "kuka": "as $AXIS_ACT has it",
    "format": "by its form",
    "": "",
}
_SAID_BY = {
    "name": "by its name",
    "column": "by a column",
    "file": "by the file's name",
    "stated": "as stated",
    "only": "there is only this",
    "order": "by the order",
    "place": "by its place",
    "row": "by its row",
}
_ANGLES = {
    "plan": "as planned",
    "columns": "from the points' own columns",
    "names": "from the joint log, by the names of its rows",
    "order": "from the joint log, row by row",
    "time": "from the joint log, by the time of every point",
}
_FEW = 6
_SHOWN = 4


def taken_table(found: Imported) -> ReportTable:
    """Every column, and what it was taken as."""
    rows: list[tuple[str, ...]] = []
    for listing in found.files:
        rows += [(listing.sheet.where, t.column, t.role, _unit(t)) for t in listing.taken]
        rows += [(listing.sheet.where, column, "-", "not used") for column in listing.left]
    return ReportTable(("file", "column", "taken as", "unit"), tuple(rows))


def _unit(taken: Taken) -> str:
    return ", ".join(part for part in (taken.unit, _BY[taken.by]) if part)


def point_table(found: Imported) -> ReportTable:
    """The first points of every file, and what they were taken for."""
    rows: list[tuple[str, ...]] = []
    for listing in dict.fromkeys(p.listing for p in found.points):
        for p in [q for q in found.points if q.listing is listing][:_SHOWN]:
            assert p.slot is not None
            rows.append((p.listing.sheet.path.name, str(p.line), p.name or "-", label(p.slot), _how(p)))
    return ReportTable(("file", "line", "name", "taken for", "known"), tuple(rows))


def _how(point: TrackerPoint) -> str:
    """How pose, marker and state are known, each way once."""
    origins = {**point.by}
    if origins.get("pose") == "column" and point.listing.column("pose") is None:
        origins["pose"] = "name" if point.name else "row"
    parts = [
        f"{kind if kind != 'loaded' else 'state'} {_SAID_BY[by]}" for kind, by in origins.items() if by in _SAID_BY
    ]
    ways = set(origins.values())
    return f"all {_SAID_BY[next(iter(ways))]}" if len(ways) == 1 and len(origins) == 3 else ", ".join(parts)


def import_words(found: Imported) -> tuple[str, ...]:
    """What was made of the files, in sentences."""
    said = [_file_words(listing) for listing in found.files]
    said += [_sheet_words(sheet) + "one of our own tables, written anew" for sheet in found.sheets]
    if not found.points:
        return (*said, *found.readings.about_reads)
    slots = [p.slot for p in found.points if p.slot is not None]
    loaded = sum(s.loaded for s in slots)
    poses = len({s.pose for s in slots})
    said.append(
        f"{len(slots)} points at {poses} poses, {loaded} loaded and {len(slots) - loaded} unloaded; "
        f"angles {_ANGLES[found.angles]}"
    )
    unknown = sorted({w for p in found.points for w in p.said.unknown if p.slot is None or w not in p.slot.pose})
    if unknown:
        said.append(f"ignored words in names: {_few(unknown)}")
    if found.ignored:
        said.append(f"ignored as requested: {_few([p.name for p in found.ignored])}")
    if found.hidden:
        rows = [f"{p.listing.sheet.path.name}, line {p.line}{f' ({p.name})' if p.name else ''}" for p in found.hidden]
        said.append(f"{len(rows)} points with no line of sight are not used: {_few(rows)}")
    if found.missing:
        said.append(
            f"{len(found.missing)} readings of the plan have no point: {_few([label(s) for s in found.missing])}"
        )
    return (*said, *_placed_words(found), *found.readings.about_reads)


def _few(names: Sequence[str]) -> str:
    return some_of(names, _FEW, "; ")


def _sheet_words(sheet: Sheet) -> str:
    if sheet.form:
        return f"{sheet.where}: {len(sheet.rows)} {sheet.form}, {f'{sheet.encoding}, ' if sheet.encoding else ''}"
    if not sheet.separator:
        return f"{sheet.where}: {len(sheet.rows)} rows, "
    sign = "decimal comma" if sheet.decimal == "," else "decimal point"
    between = f"{sheet.separator!r}" if len(sheet.separator) == 1 else f"a {sheet.separator}"
    return f"{sheet.where}: {len(sheet.rows)} rows, {between} between columns, {sign}, {sheet.encoding}, "


def _file_words(listing: Listing) -> str:
    sheet = listing.sheet
    kind = "a point list" if listing.is_points else "a joint log"
    more = f", {len(sheet.blocks)} blocks of columns: {_few(sheet.blocks)}" if sheet.blocks else ""
    more += f"; text below the table, not read: {_few(sheet.below)}" if sheet.below else ""
    return _sheet_words(sheet) + kind + more


def _placed_words(found: Imported) -> list[str]:
    said: list[str] = []
    for placed in found.placed:
        of = f" of series {placed.series}" if placed.series else ""
        if not placed.count:
            said.append(f"the points{of} are too few, or too much in a line, to check where they lie")
            continue
        size = f"{1e3 * placed.rms:.3f} mm RMS, {1e3 * placed.largest:.3f} mm at most"
        said.append(f"against the rigid nominal arm, in the frame that suits them best, the points{of} miss {size}")
    return said


def aligned_words(found: Aligned) -> tuple[str, ...]:
    """The frame, how sure it is, and what the points miss."""
    kind = "known points" if found.kind == "known" else "unloaded readings"
    sd = found.sd
    worst = int(np.argmax(found.missed))
    said = [
        f"frame{f' of series {found.frame.series}' if found.frame.series else ''} from {found.count} {kind}: "
        f"they miss {1e3 * found.rms:.4f} mm RMS, {1e3 * found.missed[worst]:.4f} mm at most ({found.names[worst]})"
    ]
    if np.isfinite(sd).all():
        shift = ", ".join(f"{1e3 * v:.4f}" for v in sd[:3])
        turn = ", ".join(f"{1e3 * v:.4f}" for v in sd[3:])
        said.append(f"sd of its origin, mm: {shift}; of its turn, mrad: {turn} (k = 1, along the tracker's axes)")
    if found.kind == "unloaded":
        said.append("what the nominal arm gets wrong is part of what they miss; a fit finds the frame with the rest")
    return tuple(said)


def missed_table(found: Aligned) -> ReportTable:
    """What each known point misses."""
    rows = tuple((n, f"{1e3 * m:.4f}") for n, m in zip(found.names, found.missed.tolist(), strict=True))
    return ReportTable(("known point", "misses, mm"), rows)


def frame_yaml(found: Aligned) -> str:
    """The line that states the frame in an experiment, under `frames:`."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(found.frame.rotation).as_quat().tolist()
    place = ", ".join(f"{1e3 * v:.6f}" for v in found.frame.origin.tolist())
    turn = ", ".join(f"{v:.12f}" for v in (w, x, y, z))
    return f"{found.frame.series or 'NAME'}: {{xyz_mm: [{place}], quat_wxyz: [{turn}]}}"


def import_json(found: Imported) -> dict[str, Any]:
    """The same as values, SI."""
    return {
        "files": [
            {
                "file": str(li.sheet.path),
                "sheet": li.sheet.name,
                "form": li.sheet.form,
                "separator": li.sheet.separator,
                "decimal": li.sheet.decimal,
                "encoding": li.sheet.encoding,
                "rows": len(li),
                "columns": [{"column": t.column, "as": t.role, "unit": t.unit, "by": t.by} for t in li.taken],
                "not_used": list(li.left),
            }
            for li in found.files
        ],
        "match": found.match,
        "angles": found.angles,
        "points": [{**_point_json(p), "taken_for": label(p.slot)} for p in found.points if p.slot is not None],
        "missing": [label(s) for s in found.missing],
        "ignored": [p.name for p in found.ignored],
        "hidden": [_point_json(p) for p in found.hidden],
        "placed": [{"series": p.series, "count": p.count, "rms": p.rms, "largest": p.largest} for p in found.placed],
        "frames": [_frame_json(a) for a in found.aligned],
    }


def _point_json(p: TrackerPoint) -> dict[str, Any]:
    return {"file": str(p.listing.sheet.path), "line": p.line, "name": p.name}


def _frame_json(found: Aligned) -> dict[str, Any]:
    known = bool(np.isfinite(found.covariance).all())
    return {
        "series": found.frame.series,
        "from": found.kind,
        "rotation": found.frame.rotation.tolist(),
        "origin": found.frame.origin.tolist(),
        "covariance": found.covariance.tolist() if known else None,
        "points": dict(zip(found.names, found.missed.tolist(), strict=False)),
        "rms": found.rms,
    }
