"""From readings of states to displacements, with the errors that one unloaded reading brings to several loads."""

from __future__ import annotations

import numpy as np

from qsframework.errors import InputError, Problem
from qsframework.experiment import Experiment, Readings, StateReadings
from qsframework.identify.noise import grouped, reference_groups
from qsframework.identify.observations import Noise
from qsframework.plugin import Array, Conditions, Indices, Poses
from qsframework.plugin.facts import frozen


def differences(states: StateReadings, experiment: Experiment) -> tuple[Readings, Noise]:
    """Displacements (loaded minus unloaded position of each marker) and the covariance of all their scalars.

    A loaded row is measured against the unloaded row of its pose, series and marker with its load_id, repeat and
    cycle; else against that without a load_id; else against the pose's only unloaded row. The displacements are in
    the tracker's axes, which must be those of the base. Masked rows are left out. The experiment's sigma is here that
    of one position, as in a fit of the positions themselves, so that a displacement has sqrt(2) of it.

    Raises InputError that names the loaded rows without an unloaded one, or with one in another drive state.
    """
    loaded = np.flatnonzero(states.use & states.loaded[states.measurement])
    if not len(loaded):
        raise InputError(f"{states.source or 'state readings'}: no row of a loaded state; displacements need one")
    unloaded = _references(states, loaded)
    _check_drives(states, loaded, unloaded)
    sigma = _sigmas(states, experiment, loaded, unloaded)
    used, measurement = np.unique(states.measurement[loaded], return_inverse=True)
    poses = states.poses.take(used)
    first = np.array([np.flatnonzero(measurement == m)[0] for m in range(len(used))])
    poses = Poses(poses.pendant, poses.q, poses.wrench, _before(states, unloaded[first]), poses.loaded)
    names = tuple(_name(states, int(m)) for m in states.measurement[unloaded])
    stated = np.isfinite(sigma).all()
    total = np.sqrt(np.square(sigma).sum(axis=0)) if stated else np.full(len(loaded), np.nan)
    drive = None if states.drive_state is None else tuple(states.drive_state[int(i)] for i in loaded)
    measured = (int(m) for m in used)
    labels = tuple(states.pose[m] + (f" {states.load_id[m]}" if states.load_id[m] else "") for m in measured)
    readings = Readings(
        poses, labels, states.repeat[used], states.cycle[used], measurement, states.marker[loaded],
        frozen(states.position[loaded] - states.position[unloaded]), frozen(total), np.ones(len(loaded), dtype=bool),
        states.rows[loaded], drive, states.source, names,
        frozen(np.square(sigma[0]) / np.square(total)) if stated else None,
    )  # fmt: skip
    each = np.repeat(sigma if stated else np.full_like(sigma, np.sqrt(0.5)), 3, axis=1)
    return readings, grouped(each[1], [(reference_groups(readings, np.arange(len(loaded))), each[0])])


def _check_drives(states: StateReadings, loaded: Indices, unloaded: Indices) -> None:
    """InputError where the two states of a displacement were read in different drive states: two different arms."""
    if states.drive_state is None:
        return
    problems: list[Problem] = []
    for i, j in zip(map(int, loaded), map(int, unloaded), strict=True):
        here, there = states.drive_state[i], states.drive_state[j]
        if here and there and here != there:
            message = f"the loaded state was read in drive state {here!r}, its unloaded one (line {states.rows[j]}) in"
            hint = "A held brake and a servo give differently: read both alike, or put 0 in the row's column use."
            problems.append(
                Problem(f"{message} {there!r}", str(states.source or "state readings"), int(states.rows[i]),
                        "drive_state", hint=hint)
            )  # fmt: skip
    if problems:
        raise InputError(problems)


def _name(states: StateReadings, m: int) -> str:
    """Name of an unloaded state."""
    parts = (states.pose[m], states.series[m], states.load_id[m], str(states.repeat[m]), str(states.cycle[m]))
    return "/".join(parts)


def _references(states: StateReadings, loaded: Indices) -> Indices:
    """The unloaded row (L,) of each loaded row."""
    exact: dict[tuple[object, ...], int] = {}
    of_pose: dict[tuple[object, ...], list[int]] = {}
    for i in np.flatnonzero(states.use & ~states.loaded[states.measurement]).tolist():
        m = int(states.measurement[i])
        place = (states.pose[m], states.series[m], int(states.marker[i]))
        exact[(*place, states.load_id[m], int(states.repeat[m]), int(states.cycle[m]))] = i
        of_pose.setdefault(place, []).append(i)
    out: list[int] = []
    problems: list[Problem] = []
    for i in loaded.tolist():
        m = int(states.measurement[i])
        place = (states.pose[m], states.series[m], int(states.marker[i]))
        turn = (int(states.repeat[m]), int(states.cycle[m]))
        only = of_pose.get(place, [])
        found = exact.get((*place, states.load_id[m], *turn), exact.get((*place, "", *turn)))
        found = only[0] if found is None and len(only) == 1 else found
        if found is None:
            message = f"pose {states.pose[m]!r}: this loaded row has no unloaded one to be measured against"
            hint = "Measure the marker unloaded at the same pose, with the same load_id, repeat and cycle."
            problems.append(Problem(message, str(states.source or "state readings"), int(states.rows[i]), hint=hint))
        out.append(-1 if found is None else found)
    if problems:
        raise InputError(problems)
    return np.array(out, dtype=np.intp)


def _sigmas(states: StateReadings, experiment: Experiment, loaded: Indices, unloaded: Indices) -> Array:
    """sd (2, L) m of the unloaded and the loaded position of each displacement; all NaN where nothing is stated."""
    one = np.nan if experiment.noise.sigma is None else experiment.noise.sigma
    sigma = np.stack([states.sigma[unloaded], states.sigma[loaded]])
    sigma = np.where(np.isnan(sigma), one, sigma)
    if np.isnan(sigma).any() and not np.isnan(sigma).all():
        name = states.source or "state readings"
        raise InputError(f"{name}: some rows have no sigma_mm and the experiment states no noise; give all or none")
    return sigma


def _before(states: StateReadings, rows: Indices) -> Conditions:
    """The conditions of the unloaded states behind measurements."""
    return states.poses.unloaded.take(states.measurement[rows])
