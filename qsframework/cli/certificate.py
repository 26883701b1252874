"""`qsf certificate`: what it calls and prints."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

from qsframework.cli.commands import distinct_outputs, load_campaign, readings_files
from qsframework.cli.printing import print_folded, print_notes
from qsframework.cli.progress import progress
from qsframework.experiment import read_readings


def run_certificate(
    experiment_file: Path,
    fit: Path,
    data: Sequence[Path],
    output: Path,
    meta: Path | None,
    halves: int,
    seed: int,
    anyway: bool,
) -> None:
    """Certify a fit, say its main numbers, and write the page."""
    from qsframework.fits import read_fit
    from qsframework.report.certificate_page import heads, write_certificate
    from qsframework.report.words.certificate import conformity_words
    from qsframework.report.words.validation import validation_words
    from qsframework.uses.certificate import certify, read_meta

    experiment = load_campaign(experiment_file)
    stored = read_fit(fit)
    sources = readings_files(experiment, data)
    distinct_outputs([output], [experiment_file, fit, *sources, *([meta] if meta else [])])
    stated = read_meta(meta)
    with progress() as tell:
        tell("certificate", 0, 1)
        readings = read_readings(sources, experiment)
        found = certify(experiment, stored, readings, stated, halves=halves, seed=seed, anyway=anyway)
    print_folded(conformity_words(found.conformity))
    print_folded(validation_words(found.validation))
    print_folded(*stored.account.scope())
    print_notes(found.notes)
    left = [f"{title.lower()}: {name}" for title, part in heads(found) for name, value in part if not value]
    if left:
        print_folded(f"note: left blank: {', '.join(left)}. --meta states them; --template writes such a file")
    print(f"certificate: {write_certificate(output, found)}")


def write_template(output: Path, inputs: Sequence[Path]) -> None:
    """Write a meta.yaml to fill in, over no other file that the command names."""
    from qsframework.files import write_text

    distinct_outputs([output], inputs)
    text = files("qsframework.report").joinpath("templates", "meta.yaml").read_text(encoding="utf-8")
    print(f"fill in and give it as --meta: {write_text(output, text)}")
