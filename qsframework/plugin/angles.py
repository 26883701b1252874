"""Cosine and sine together."""

from __future__ import annotations

import numpy as np

from qsframework.plugin.facts import Array


def cos_sin(angle: Array) -> tuple[Array, Array]:
    """Cosine and sine of angles, rad, to the last digits of 1: by the tangent of their halves,
    cos = (1 - t^2) / (1 + t^2), sin = 2 t / (1 + t^2). On many processors numpy has a tangent that is eight times as
    fast as its sine."""
    if np.iscomplexobj(angle):  # by complex step a tangent loses what is left of it near pi
        return np.cos(angle), np.sin(angle)
    half = np.tan(0.5 * angle)
    square = half * half
    share = 1.0 / (1.0 + square)
    return (1.0 - square) * share, 2.0 * half * share
