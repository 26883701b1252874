"""A plan as a file for the robot's controller."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from qsframework.arguments import checked
from qsframework.experiment import WRENCH_NAMES, table_text
from qsframework.files import write_text
from qsframework.plugin import InputError, Language, Problem, Programme, languages, maker_of, nearest, refuse

CSV = "csv"
"""The form that needs no language: a table, for controllers that none is installed for."""
_NAME = re.compile(r"[A-Za-z0-9_.+-]{1,16}")
"""A pose's name that every format can hold."""


@checked
def export(programme: Programme, to: str, path: str | Path) -> tuple[Path, ...]:
    """Write a programme in a controller's format.

    Args:
        programme: from `make_programme`.
        to: a form, such as "krl" or "csv".
        path: the file; krl makes a .src and a .dat of it.

    Returns:
        The files written.

    Raises:
        InputError: for another maker's robot, or names that the format cannot hold.
    """
    return tuple(write_text(file, text) for file, text in written(programme, to, Path(path)).items())


def written(programme: Programme, to: str, path: Path) -> dict[Path, str]:
    """The files of a format and their texts. InputError as of `export`."""
    check_form(programme, to)
    names = dict.fromkeys(m.pose for m in programme.moves if m.measured and not _NAME.fullmatch(m.pose))
    allowed = "1 to 16 letters, digits and _ . + -"
    hint = "Name it so in the plan's column pose."
    message = "the controller cannot hold this name"
    refuse([Problem(f"pose {name!r}: {message}", allowed=allowed, hint=hint) for name in names])
    if to == CSV:
        return {path: write_csv(_without_frames(programme, to))}
    language = forms()[to]
    texts = language.write(_with_frames(programme, language), path.stem)
    names = [path] if len(texts) == 1 else [path.with_suffix(ending) for ending in language.written]
    return dict(zip(names, texts, strict=True))


def forms() -> dict[str, Language]:
    """The languages in which plans are written, by the names of their forms."""
    return {language.form: language for language in languages().values() if language.form}


def endings(to: str) -> tuple[str, ...]:
    """How a form's files end; () for any ending, and for no form."""
    return forms()[to].written if to in forms() else ()


def _without_frames(programme: Programme, to: str) -> Programme:
    """The programme. InputError where a tool or a frame is asked for."""
    if programme.tool or programme.frame:
        found = f"{programme.tool} {programme.frame}".strip()
        message = f"{to} states joint angles, for which no tool and no frame is chosen"
        raise InputError(Problem(message, found=found, hint="Leave them out."))
    return programme


def _with_frames(programme: Programme, language: Language) -> Programme:
    """The programme with its tool and frame, those of the language where none are asked for."""
    if not language.tool:
        return _without_frames(programme, language.form)
    made = replace(programme, tool=programme.tool or language.tool, frame=programme.frame or language.frame)
    refuse(
        [
            Problem(f"the {what} of the controller", found=repr(name), allowed=language.names_of_frames)
            for what, name in (("tool", made.tool), ("frame", made.frame))
            if not re.fullmatch(language.name_of_frame, name, re.ASCII)
        ]
    )
    return made


def check_form(programme: Programme, to: str) -> None:
    """InputError for an unknown form, or that of another maker's controller."""
    known = (*forms(), CSV)
    if to not in known:
        raise InputError(Problem(f"unknown format {to!r}", allowed=", ".join(known), hint=nearest(to, known)))
    if to == CSV:
        return
    if any(programme.units.sliding):
        axes = ", ".join(f"J{k + 1}" for k, slides in enumerate(programme.units.sliding) if slides)
        message = f"{to} holds turning axes only so far, and {axes} of this arm slides"
        raise InputError(Problem(message, hint="Use csv.", argument=("to", CSV)))
    maker, own = maker_of(programme.title), forms()[to].maker
    if maker not in (None, own):
        other = next((form for form, language in forms().items() if language.maker == maker), CSV)
        message, hint = f"{to} is for controllers by {own}", f"Use {other}."
        raise InputError(Problem(message, found=programme.title, hint=hint, argument=("to", other)))


def write_csv(programme: Programme) -> str:
    """One row per stop, in the order of the way."""
    payload = "not stated" if programme.payload is None else f"{programme.payload:g} kg"
    comments = [f"robot: {programme.robot}", f"payload: {payload}"]
    if programme.loaded:
        comments.append("load: hang it after the arm has stopped, take it off again before the arm starts")
    stands = any(move.station for move in programme.moves)
    last = ["load", *WRENCH_NAMES[:3], *(["tracker_moves_to"] if stands else [])]
    header = ["stop", "pose", "visit", *programme.units.names(), "speed_percent", "pause_s", *last]
    rows: list[list[str]] = []
    for i, move in enumerate(programme.moves, start=1):
        pause = "0" if not move.measured else "hold" if programme.pause is None else repr(programme.pause)
        degrees = [f"{v:.4f}" for v in programme.units.shown(move.pendant) + 0.0]
        row = [str(i), move.pose, str(move.repeat), *degrees, str(programme.speed), pause, move.load]
        rows.append([*row, *(f"{f:g}" for f in move.force), *([move.station] if stands else [])])
    return table_text(header, rows, comments)
