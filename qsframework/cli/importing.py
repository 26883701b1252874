"""`qsf import`: what it calls, prints and writes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from qsframework.applications.importers import ImportOptions, import_readings
from qsframework.applications.importers.importing import UNLOADED
from qsframework.applications.importers.mapping import read_mapping
from qsframework.cli.commands import distinct_outputs, write_json
from qsframework.cli.pairs import pairs
from qsframework.cli.printing import print_folded, print_table
from qsframework.experiment import load_experiment
from qsframework.experiment.measured import keep_measured, write_imported


@dataclass(frozen=True, kw_only=True)
class ImportFiles:
    """What the command reads and writes; look: show what would be taken for what, and write nothing."""

    experiment: Path
    files: tuple[Path, ...]
    plan: Path | None
    mapping: Path | None
    output: Path
    json: Path | None
    look: bool


def columns_of(texts: Sequence[str]) -> Mapping[str, str]:
    """--map role=column, several of them joined by commas or given one by one."""
    split = [part for text in texts for part in _parts(text)]
    return pairs("--map", split, "ROLE=COLUMN, such as x=Xcoord or x=3")


def _parts(text: str) -> list[str]:
    """The pairs of one option; a comma inside a column's name stays in it."""
    out: list[str] = []
    for part in text.split(","):
        if "=" in part or not out:
            out.append(part)
        else:
            out[-1] += f",{part}"
    return out


def words_of(texts: Sequence[str]) -> Mapping[str, str]:
    """--word found=meant."""
    return pairs("--word", texts, "FOUND=MEANT, such as WITH=loaded or ball1=m1")


def run_import(files: ImportFiles, options: ImportOptions) -> None:
    """Show what was taken for what, then write the readings."""
    from qsframework.report.words.imports import (
        aligned_words,
        frame_yaml,
        import_json,
        import_words,
        missed_table,
        point_table,
        taken_table,
    )
    from qsframework.screening import find_mistakes

    inputs = [files.experiment, *files.files, *(p for p in (files.plan, files.mapping) if p is not None)]
    inputs += [Path(options.align)] if options.align not in ("", UNLOADED) else []
    distinct_outputs([None if files.look else files.output, files.json], inputs)
    if not files.look:
        keep_measured([files.output], "-o")
    experiment = load_experiment(files.experiment)
    if files.mapping is not None:
        stated = read_mapping(files.mapping)
        options = replace(
            options,
            columns={**stated.columns, **options.columns},
            names={**stated.names, **options.names},
            units=(*stated.units, *options.units),
        )
    found = import_readings(experiment, files.files, files.plan, options)
    for table in (taken_table(found), point_table(found)):
        if table.rows:
            print_table(table.header, table.rows)
    for said in import_words(found):
        print_folded(f"- {said}")
    for aligned in found.aligned:
        if aligned.kind != UNLOADED:
            missed = missed_table(aligned)
            print_table(missed.header, missed.rows)
        for said in aligned_words(aligned):
            print_folded(f"- {said}")
        print("to state it in the experiment, where the series of the readings (--series) has that name:")
        print(f"frames:\n  {frame_yaml(aligned)}")
    for wrong in find_mistakes(experiment, found.readings):
        if wrong.told:
            print_folded(f"! {wrong.title}: {wrong.words}")
    if files.json is not None:
        write_json(files.json, import_json(found))
    if files.look:
        print("nothing is written")
        return
    write_imported(files.output, found.header, found.rows, experiment.robot.name)
    print(f"{len(found.readings)} readings at {len(set(found.readings.pose))} poses: {files.output}")
    print(f"next: qsf identify {files.experiment} {files.output}")
