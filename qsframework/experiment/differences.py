"""From positions of states to displacements: loaded minus unloaded, in the axes of the base."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from qsframework.errors import InputError, Problem, refuse
from qsframework.experiment.frames import Frame, procrustes
from qsframework.experiment.readings import Alignment, Readings
from qsframework.experiment.setup import Experiment
from qsframework.plugin import Array, Indices
from qsframework.plugin.facts import frozen

_TURNED = 0.02
"""rad: a series turned by less has the axes of the base, as far as its geometry can say."""
_SPREAD = 0.05
"""m: unloaded markers that spread less than this across a line do not tell how a series lies to the base."""


def has_pairs(states: Readings) -> bool:
    """Whether some loaded row of positions has an unloaded one of the same pose, series and marker."""
    unloaded = {_place(states, i) for i in np.flatnonzero(states.use & ~states.states.loaded[states.plus]).tolist()}
    loaded = np.flatnonzero(states.use & states.states.loaded[states.plus]).tolist()
    return any(_place(states, i) in unloaded for i in loaded)


def differences(states: Readings, experiment: Experiment) -> Readings:
    """Displacements (loaded minus unloaded position of each marker) of readings of states.

    A loaded row is measured against the unloaded row of its pose, series and marker with its load_id, repeat and
    cycle; else against that without a load_id; else against the pose's only unloaded row. How a series lies to the
    base is taken from its unloaded markers, or stated; masked rows are left out.

    Raises InputError that names the loaded rows without an unloaded one, or with one in another drive state.
    """
    loaded = np.flatnonzero(states.use & states.states.loaded[states.plus])
    if not len(loaded):
        raise InputError(f"{states.where}: no row of a loaded state; displacements need one")
    unloaded = _partners(states, loaded)
    _check_drives(states, loaded, unloaded)
    known, alignments = _aligned(states, experiment)
    sigma = np.sqrt(states.sigma[loaded] ** 2 + states.sigma[unloaded] ** 2)
    directed = None if states.directed is None else np.sqrt(2.0) * states.directed[loaded]  # of the same place
    turned = {f for f, a in enumerate(alignments) if a.turned}
    frame = np.array([f if f in turned else -1 for f in states.frame[loaded].tolist()], dtype=np.intp)
    axes = None if states.axes is None else states.axes[loaded]
    drive = None if states.drive_state is None else tuple(states.drive_state[int(i)] for i in loaded)
    return replace(
        states,
        plus=states.plus[loaded],
        minus=states.plus[unloaded],
        marker=states.marker[loaded],
        frame=frame,
        known=known,
        value=frozen(states.value[loaded] - states.value[unloaded]),
        sigma=frozen(sigma),
        minus_sigma=frozen(states.sigma[unloaded]),
        use=states.use[loaded],
        line=states.line[loaded],
        file=states.file[loaded],
        to=states.to[loaded],
        directed=directed,
        axes=axes,
        reads=None if states.reads is None else states.reads[loaded],
        drive_state=drive,
        alignments=alignments,
    )


def _place(states: Readings, i: int) -> tuple[object, ...]:
    """Pose, series and marker (of a gauge its direction too) of a row."""
    s = int(states.plus[i])
    along = () if states.axes is None else tuple(states.axes[i, 0].round(9).tolist())
    return (states.states.pose[s], states.states.series[s], int(states.marker[i]), int(states.to[i]), along)


def _partners(states: Readings, loaded: Indices) -> Indices:
    """The unloaded row (L,) of each loaded row."""
    exact: dict[tuple[object, ...], int] = {}
    of_pose: dict[tuple[object, ...], list[int]] = {}
    own = states.states
    for i in np.flatnonzero(states.use & ~own.loaded[states.plus]).tolist():
        s, place = int(states.plus[i]), _place(states, i)
        exact[(*place, own.load_id[s], int(own.repeat[s]), int(own.cycle[s]))] = i
        of_pose.setdefault(place, []).append(i)
    out: list[int] = []
    problems: list[Problem] = []
    for i in loaded.tolist():
        s, place = int(states.plus[i]), _place(states, i)
        turn = (int(own.repeat[s]), int(own.cycle[s]))
        only = of_pose.get(place, [])
        found = exact.get((*place, own.load_id[s], *turn), exact.get((*place, "", *turn)))
        found = only[0] if found is None and len(only) == 1 else found
        if found is None:
            message = f"pose {own.pose[s]!r}: this loaded row has no unloaded one to be measured against"
            hint = "Measure the marker unloaded at the same pose, with the same load_id, repeat and cycle."
            problems.append(states.problem(i, message, hint=hint))
        out.append(-1 if found is None else found)
    refuse(problems)
    return np.array(out, dtype=np.intp)


def _check_drives(states: Readings, loaded: Indices, unloaded: Indices) -> None:
    """InputError where the two states of a displacement were read in different drive states: two different arms."""
    if states.drive_state is None:
        return
    problems: list[Problem] = []
    for i, j in zip(map(int, loaded), map(int, unloaded), strict=True):
        here, there = states.drive_state[i], states.drive_state[j]
        if here and there and here != there:
            message = f"the loaded state was read in drive state {here!r}, its unloaded one (line {states.line[j]}) in"
            hint = "A held brake and a servo give differently: read both alike, or put 0 in the row's column use."
            problems.append(states.problem(i, f"{message} {there!r}", "drive_state", hint=hint))
    refuse(problems)


def _aligned(states: Readings, experiment: Experiment) -> tuple[tuple[Frame | None, ...], tuple[Alignment, ...]]:
    """The frame of each series, stated or found from its unloaded markers, and what these then miss."""
    there = experiment.rigid_places(states.poses.q)[states.plus, states.marker]
    whole = np.isfinite(states.value).all(axis=1) & states.use & ~states.states.loaded[states.plus]
    frames: list[Frame | None] = []
    said: list[Alignment] = []
    for f, (name, known) in enumerate(zip(states.frames, states.known, strict=True)):
        rows = np.flatnonzero(whole & (states.frame == f))
        frame = known
        if frame is None and _spreads(there[rows]):
            frame = procrustes(there[rows], states.value[rows], name)
        if frame is None:
            frames.append(Frame(name, np.eye(3), np.zeros(3)))
            said.append(Alignment(name, 0.0, float("nan"), float("nan"), 0, False))
            continue
        missed = (
            np.linalg.norm(states.value[rows] - frame.apply(there[rows]), axis=1) if len(rows) else np.full(1, np.nan)
        )
        angle = float(np.linalg.norm(frame.pose[3:]))
        turned = known is not None or angle > _TURNED
        frames.append(frame)
        said.append(Alignment(name, angle, float(np.sqrt(np.mean(missed**2))), float(missed.max()), len(rows), turned))
    return tuple(frames), tuple(said)


def _spreads(points: Array) -> bool:
    if len(points) < 3:
        return False
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] >= _SPREAD * np.sqrt(len(points)))
