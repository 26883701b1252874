"""`qsf import`: what it calls, prints and writes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from qsf_trackers.options import ImportFiles, ImportOptions
from qsframework.cli import Trust, distinct_outputs, load_campaign, print_folded, print_table, write_json
from qsframework.errors import InputError


def import_files(files: ImportFiles, options: ImportOptions, trust: Trust = False) -> None:
    """Convert a tracker's export into readings."""
    from qsf_trackers.importing import UNLOADED, import_readings
    from qsf_trackers.mapping import read_mapping
    from qsf_trackers.words import (
        aligned_words,
        frame_yaml,
        import_json,
        import_words,
        missed_table,
        point_table,
        taken_table,
    )
    from qsframework.experiment import keep_measured, write_imported
    from qsframework.screening import find_mistakes

    inputs = [files.experiment, *files.files, *(p for p in (files.plan, files.mapping) if p is not None)]
    inputs += [Path(options.align)] if options.align not in ("", UNLOADED) else []
    distinct_outputs([None if files.look else files.output, files.json], inputs)
    if not files.look:
        keep_measured([files.output], "-o")
    experiment = load_campaign(files.experiment)
    mapping = None
    if files.mapping is not None:
        mapping = read_mapping(files.mapping)
        stated = mapping.spec
        options = replace(
            options,
            columns={**stated.columns, **options.columns},
            names={**stated.names, **options.names},
            units=(*stated.units, *options.units),
        )
    try:
        found = import_readings(experiment, files.files, files.plan, options)
    except InputError as error:
        raise error if mapping is None else mapping.placed(error) from error
    for table in (taken_table(found), point_table(found)):
        if table.rows:
            print_table(table.header, table.rows)
    print_folded(*(f"- {sentence}" for sentence in import_words(found)))
    for aligned in found.aligned:
        if aligned.kind != UNLOADED:
            missed = missed_table(aligned)
            print_table(missed.header, missed.rows)
        print_folded(*(f"- {sentence}" for sentence in aligned_words(aligned)))
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
