"""`qsf kinematics`: what it calls and prints."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from qsframework.cli.commands import certificate_of_positions, distinct_outputs, load_campaign, write_json
from qsframework.cli.printing import print_folded, print_notes, print_table
from qsframework.errors import some_of
from qsframework.files import as_file
from qsframework.fits import read_fit
from qsframework.uses.kinematics import WRITERS, Fitted, Written, fitted, offset_rows, write_offsets

_NAMES = {
    "urdf": "corrected URDF",
    "dh": "Denavit-Hartenberg table",
    "mdh": "modified Denavit-Hartenberg table",
    "hayati": "table with Hayati's number",
    "ur": "kinematics of the Universal Robots driver",
}


def run_kinematics(
    file: Path, fit_file: Path, outputs: Mapping[str, Path], offsets: Path | None, json: Path | None, anyway: bool
) -> None:
    """Print the joints' offsets, write the files that are asked for, and say what each differs by and lacks."""
    distinct_outputs([*outputs.values(), offsets, json], [file, fit_file])
    experiment, fit = load_campaign(file), read_fit(fit_file)
    one = fitted(experiment, fit, anyway=anyway)
    rows = offset_rows(one)
    print_table(tuple(rows[0]), tuple(tuple(row.values()) for row in rows))
    print_folded(_held(one))
    print_folded(*one.account.scope())
    print_notes(one.notes)
    files = {kind: WRITERS[kind](one, path) for kind, path in outputs.items()}
    for kind, written in files.items():
        print_folded(_said(_NAMES[kind], written))
    if offsets is not None:
        print(f"offsets of the joints: {write_offsets(one, offsets)}")
        alone = [row["joint"] for row in rows if not row["add_deg"]]
        if alone:
            words = f"no offset of {some_of(alone)}: not identifiable beside other numbers that do the same"
            print_folded(f"{words}. Take the whole kinematics.")
    if json is not None:
        content = {kind: _content(written) for kind, written in files.items()}
        more = {"held": list(one.held), "missing": list(one.missing), "account": as_file(one.account)}
        write_json(json, {"files": content, "offsets": rows, **more})
    if one.account.positions:
        print(f"next: {certificate_of_positions(experiment, fit_file, one.account)}")


def _held(one: Fitted) -> str:
    """What the kinematics hold of the fit."""
    text = f"The rigid kinematics hold {len(one.held)} of {len(one.held) + len(one.missing)} identified values."
    if not one.held:
        text = "No geometry was identified: the kinematics are the nominal ones."
    if one.missing:
        shown, more = ", ".join(one.missing[:12]), len(one.missing) - 12
        text += (
            " Not in them, for no table of an arm holds them (compliances and terms of the pose or of the campaign): "
        )
        text += shown
        text += f" and {more} more." if more > 0 else "."
    return text


def _said(name: str, written: Written) -> str:
    text = f"{name}, read back: {written.path}; at most {written.away:.1e} m and {written.turned:.1e} rad from the fit"
    if written.far:
        text += (
            f". d of {', '.join(written.far)} is more than 10 m, for two axes are nearly parallel: rounded "
            "to a few digits it is lost; use the corrected URDF, or --hayati"
        )
    return text


def _content(written: Written) -> dict[str, object]:
    return {
        "file": str(written.path),
        "away_m": written.away,
        "turned_rad": written.turned,
        "far": list(written.far),
    }
