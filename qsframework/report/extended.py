"""The extended robot that a diagnosis calls for: its named causes with their evidence, in words, as files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from qsframework.arguments import checked
from qsframework.diagnoses.audit_entries import audited_of
from qsframework.diagnoses.extend import Extension, write_extension
from qsframework.diagnoses.result import Diagnosis
from qsframework.diagnoses.second_day import FollowUp
from qsframework.errors import InputError
from qsframework.files import sha256
from qsframework.report.words.diagnosis import diagnosis_words
from qsframework.report.words.noise import audit_words
from qsframework.report.words.sizes import mm
from qsframework.screening import adopted


@checked
def write_extended(
    diagnosis: Diagnosis, folder: str | Path, day: FollowUp | None = None, *, doubtful: bool = False
) -> tuple[Path, ...]:
    """Write the extended robot of a diagnosis and its experiment into a folder, all or nothing.

    Args:
        diagnosis: of the readings.
        folder: to make, or an empty one.
        day: the visits that would settle what is open, where they were chosen.
        doubtful: with causes that do not clearly reduce the held-out error.

    Returns:
        The paths written.

    Raises:
        InputError: as `write_extension` has them.
    """
    return write_extension(extension_of(diagnosis, day, doubtful=doubtful), folder)


def extended_words(diagnosis: Diagnosis, added: Sequence[str], *, doubtful: bool = False) -> str:
    """By what a written robot is extended and what that gains at held-out poses, where that is known."""
    if not added:
        return "Nothing is added to the model; the values are those of these readings."
    learned, rms = diagnosis.learned, diagnosis.rms
    before, after = rms.heldout_identified, rms.heldout_extended
    if learned is not None and learned.name in added:
        before, after = learned.before, learned.heldout
    gain = f": held-out error {mm(rms.in_space(before))} \u2192 {mm(rms.in_space(after))} mm (3D RMS)"
    return f"The model is extended by {', '.join(added)}{gain if doubtful or not diagnosis.doubtful else ''}."


def extension_of(diagnosis: Diagnosis, day: FollowUp | None = None, *, doubtful: bool = False) -> Extension:
    """The extension that a diagnosis calls for: its certain names and the law that was learned beside them, or all
    names without it, and the values of the exact fit. The law's weights are fitted again with all else, by the prior
    that its effect holds."""
    learned = diagnosis.learned if not (doubtful and diagnosis.doubtful) else None
    settled = diagnosis.extended if doubtful else diagnosis.certain
    if learned is not None and learned.holds:
        settled = learned.fit
    source = diagnosis.readings.source
    made_of = f", readings sha256 {sha256(source)[:16]}" if source is not None and source.is_file() else ""
    evidence = {name: f"identified beside the named causes{made_of}" for name in settled.names}
    for f in (f for f in diagnosis.findings if doubtful or not f.doubtful):
        gain = f", held-out gain {100 * f.heldout_gain:.0f} %" if f.heldout_gain == f.heldout_gain else ""
        alternatives = f"; as likely {', '.join(r.name for r in f.alternatives)}" if f.alternatives else ""
        said = f"diagnosed: s = {f.s:.1f}, p = {f.p_value:.2g}{gain}{made_of}{alternatives}"
        evidence.update({v.name: said for v in f.values})
    if learned is not None and learned.holds:
        said = f"learned: s = {learned.s:.1f}, p = {learned.leftover.p_value:.2g}"
        said += f", held-out gain {100 * learned.gain:.0f} %{made_of}; no cause of the library"
        evidence.update({name: said for cause in learned.causes for name in cause.names})
    proved = adopted(diagnosis.conventions)
    structure = next((c for c in proved if c.structure), None)
    if structure is not None:
        raise InputError(
            f"no extended robot is written: {structure.words}. Change the effects of "
            f"{diagnosis.experiment.robot.folder}, then diagnose again"
        )
    otherwise = [c for c in proved if c.name not in settled.model.names]
    notes = [diagnosis_words(diagnosis, day)]
    if otherwise:
        said = " ".join(f"{c.words}." for c in otherwise)
        notes.append(f"The readings are not named here: they have to be corrected first. {said}")
    audited = audited_of(diagnosis)
    place = "In a file of states this is the noise of one position, 1/sqrt(2) of a displacement's."
    return Extension(
        experiment=diagnosis.experiment,
        model=settled.model,
        values=settled.by_name(),
        sds={n: settled.sd(n) for n in settled.names},
        evidence=evidence,
        fit=(*settled.names, *(n for n in diagnosis.experiment.fit_names() if n not in settled.names)),
        data=None if otherwise else source,
        notes=tuple(notes),
        poses=diagnosis.readings.poses,
        audited=audited,
        about_noise=" ".join([*audit_words(diagnosis.audit), *([place] if audited.of_position else [])]),
        further=() if otherwise else diagnosis.readings.sources[1:],
        used=tuple(sha256(s) for s in diagnosis.readings.sources if s.is_file()),
    )
