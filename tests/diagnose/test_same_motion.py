"""Where else a motion of the markers could come from, against brute force and against what geometry says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from independent_arm import COILED, SEVEN, Arm

from qsframework.diagnose.diagnose import _fits  # pyright: ignore[reportPrivateUsage]
from qsframework.diagnose.linearization.generic_blocks import Block, Motions, generic_blocks, motions
from qsframework.diagnose.selection.same_motion import (
    _ALIKE,  # pyright: ignore[reportPrivateUsage]
    _anything,  # pyright: ignore[reportPrivateUsage]
    same_motion,
)
from qsframework.estimation.visit_noise import Reml
from qsframework.experiment import make_rows
from qsframework.plugin import Array
from tests.diagnose.clean_fit import clean_fit


def campaign(arm: Arm, kind: str, folder: Path, shared: bool = False) -> tuple[Motions, Reml, dict[str, Block], Array]:
    """What moves in a clean campaign, its fits, its blocks by name, and what its noise left.

    shared: the second half of the differences have the unloaded readings of the first half
    """
    _, rows, fit = clean_fit(arm, folder, poses=14, kind=kind)
    if shared:
        half = rows.readings.minus[: len(rows.readings.minus) // 2]
        rows = make_rows(replace(rows.readings, minus=np.concatenate([half, half])))
        assert len(np.unique(rows.together)) < len(np.unique(rows.plus))
    moved = motions(fit.model, rows, fit.x, fit.frames)
    fits = _fits(rows, rows.padded_noise.colour(fit.jacobian))
    return moved, fits, {b.law.name: b for b in generic_blocks(moved)}, fit.residuals.ravel()


def hidden(block: Block, fits: Reml, left: Array, s: float) -> Array:
    """Readings of a law of size s beside the noise that was left."""
    did = block.columns @ np.random.default_rng(3).standard_normal(block.columns.shape[1])
    noise = fits.unit(0, left)
    return left + did * s * noise / float(np.linalg.norm(fits.left(0, did)))


@pytest.mark.parametrize(("kind", "shared"), [("displacements", False), ("positions", False), ("displacements", True)])
def test_the_places_are_those_of_brute_force(kind: str, shared: bool, tmp_path: Path) -> None:
    """Every visit its own columns in one large matrix."""
    moved, fits, blocks, left = campaign(COILED, kind, tmp_path, shared=shared)
    block = blocks["j3/order"]
    values = hidden(block, fits, left, 12.0)
    told = same_motion(moved, block, fits, values)
    k = int(fits.choose(values[:, None])[0])
    visit = np.unique(moved.rows.plus, return_inverse=True)[1]
    did = _did(block, fits, values, k)
    noise = float(np.square(fits.left(k, values)).sum()) / fits.free
    dense: dict[Any, float] = {}
    for law, motion in _anything(moved):
        own = np.zeros((len(visit), 3, visit.max() + 1, motion.shape[2]))
        own[np.arange(len(visit)), :, visit] = motion
        X = fits.left(k, own.reshape(values.size, -1))
        rest = did - X @ np.linalg.lstsq(X, did, rcond=1e-6)[0]
        s = float(np.linalg.norm(rest)) / np.sqrt(noise)
        dense[law.where] = min(s, dense.get(law.where, np.inf))
    others = {where: s for where, s in dense.items() if where != block.law.where}
    assert {x.where for x in told} == {where for where, s in others.items() if s < 2.0}
    assert 1 < len(told) < len(others)
    order = [others[x.where] for x in told]
    assert np.all(np.diff(order) > -_ALIKE), "those that come closest come first"


def _did(block: Block, fits: Reml, values: Array, k: int) -> Array:
    """What the block's law did to whitened readings: the mean of its weights given these."""
    from qsframework.diagnose.selection.evidence import prior_of

    X, rest = fits.left(k, block.columns), fits.left(k, values)
    sd = prior_of(block.columns, fits, values)
    noise = float(rest @ rest) / fits.free
    covariance = noise * np.eye(len(X)) + sd**2 * X @ X.T
    return np.asarray(sd**2 * X @ (X.T @ np.linalg.solve(covariance, rest)))


def test_what_turns_about_one_axis_is_told_together_and_a_marker_alone(tmp_path: Path) -> None:
    """The first drive turns the arm as its base does about the vertical: no pose tells them apart. A marker that moves
    while the others stay is told from everything."""
    moved, fits, blocks, left = campaign(SEVEN, "displacements", tmp_path)
    told = {x.where for x in same_motion(moved, blocks["j1/order"], fits, hidden(blocks["j1/order"], fits, left, 60.0))}
    assert ("link", "base") in told
    assert ("link", "l1") in told
    assert not told & {("drive", "j6"), ("marker", "m1"), ("link", moved.facts.flange), ("readings", "")}
    law = blocks["m2/loaded*order"]
    assert same_motion(moved, law, fits, hidden(law, fits, left, 60.0)) == ()


def test_the_larger_the_motion_the_fewer_places(tmp_path: Path) -> None:
    moved, fits, blocks, left = campaign(COILED, "displacements", tmp_path)
    block = blocks["j4/order"]
    told = [{x.where for x in same_motion(moved, block, fits, hidden(block, fits, left, s))} for s in (4.0, 80.0)]
    assert told[1] < told[0]
