"""What the JSON files of a diagnosis and of a plan's forecast hold: their values, and the words on them."""

from __future__ import annotations

from typing import Any

import numpy as np

from qsframework.diagnoses.error_budget import error_budget
from qsframework.diagnoses.foresight import Foresight, Prospect
from qsframework.diagnoses.mounts import Mount
from qsframework.diagnoses.residuals.lack_of_fit import LackOfFit
from qsframework.diagnoses.result import Diagnosis, LearnedLaw, Leftover, Line, NamedCause
from qsframework.diagnoses.second_day import FollowUp
from qsframework.diagnoses.unknown import SIZE, UnknownOutlook
from qsframework.files import as_file
from qsframework.files.plain import is_list, is_mapping
from qsframework.report.words.diagnosis import diagnosis_words, limit_words, method_words
from qsframework.report.words.follow_up import suspect_words
from qsframework.report.words.forecast import foresight_words, size_words, why_words
from qsframework.report.words.headline import headline
from qsframework.report.words.law import place_words, variable_words
from qsframework.report.words.next_steps import next_steps
from qsframework.screening import Mistake

_RMS = ("nominal", "identified", "extended", "heldout_identified", "heldout_extended", "noise")


def diagnosis_json(found: Diagnosis, day: FollowUp | None = None) -> dict[str, Any]:
    """What `qsf diagnose` writes (SI units, RMS in mm). day: the visits that settle what is open."""
    return _finite(
        {
            "account": as_file(found.account),
            "verdict": found.verdict,
            "headline": headline(found),
            "words": diagnosis_words(found, day),
            "next": [{"do": step.do, "settles": step.settles} for step in next_steps(found, day)],
            "causes": [_cause(f) for f in found.findings],
            "conventions": [c.name for c in found.conventions if c.compelling],
            "mistakes": [_mistake(c) for c in found.conventions if c.compelling or c.suspected],
            "data_problems": _problems(found),
            "leftovers": [_law_json(x) for x in found.leftovers],
            "places": [
                {
                    "place": place_words(x.law),
                    "variable": variable_words(x.law),
                    "share": x.share,
                    "sd": x.sd,
                    "equivalent": [place_words(law) for law in x.equivalent],
                }
                for x in found.places
            ],
            "learned": None if found.learned is None else _learned(found, found.learned),
            "error_mm": {name: 1e3 * getattr(found.rms.space, name) for name in _RMS},
            "rms_per_axis_mm": {name: 1e3 * getattr(found.rms, name) for name in _RMS},
            "budget": [
                {"label": x.label, "readings_mm": _space(found, x.readings), "heldout_mm": _space(found, x.heldout)}
                for x in error_budget(found)
            ],
            "lack_of_fit": {"before": _misfit(found.before), "after": _misfit(found.after)},
            "table": [_line(x) for x in found.table],
            "plain_alone": [x.name for x in found.plain_alone],
            "notes": list(method_words(found)),
            "follow_up": None if day is None else _follow_up(day),
            "level": found.level,
            "seed": found.seed,
        }
    )


def _mistake(c: Mistake) -> dict[str, Any]:
    """A wrong convention or a mistake in the table: where, what was found and meant, and what changes with it."""
    return {
        "id": c.name,
        "applied": c.compelling,
        "words": c.words,
        "file": c.file,
        "rows": list(c.rows),
        "column": c.column,
        "found": c.found,
        "meant": c.meant,
        "rms_per_axis_mm": {"given": 1e3 * c.rms_given, "corrected": 1e3 * c.rms},
        "moved": [{"name": m.name, "before": m.before, "after": m.after} for m in c.moved],
    }


def _line(x: Line) -> dict[str, Any]:
    return {
        "id": x.name,
        "status": x.status.value,
        "s": x.s,
        "p_value": x.p_value,
        "bound": limit_words(x),
        "nearest": x.nearest,
        "angle_deg": _degrees(x.angle),
    }


def _problems(found: Diagnosis) -> list[dict[str, Any]]:
    out: list[dict[str, Any]] = []
    audit = found.audit
    if len(found.outliers):
        out.append({"id": "outliers", "rows": [int(r) for r in found.readings.line[found.outliers]]})
    noise: dict[str, Any] = {"id": "noise_level", "rows": [], "unit": audit.unit, "shared_mm": 1e3 * audit.shared}
    if audit.unit_source != "stated":
        out.append({**noise, "source": audit.unit_source, "p_value": audit.p_unit})
    elif audit.shared > 0.0:
        out.append({**noise, "source": "shared pose error", "p_value": audit.p_shared})
    return out


def _learned(found: Diagnosis, x: LearnedLaw) -> dict[str, Any]:
    return _law_json(x.leftover) | {
        "id": x.name,
        "written": x.holds,
        "s": x.s,
        "heldout_gain": x.gain,
        "heldout_clear": x.clear,
        "heldout_mm": _space(found, x.heldout),
        "weights": {name: x.alone.value(name) for name in x.cause.names},
        "averaged": [{"id": c.name, "share": share} for c, share in zip(x.causes, x.shares, strict=True)],
        "looks_like": [
            {
                "id": a.name,
                "share": a.share,
                "s_of_the_rest": a.left,
                "same_place": a.here,
                "opposite_sign": a.turned,
            }
            for a in x.alike
        ],
    }


def _law_json(x: Leftover) -> dict[str, Any]:
    return {
        "id": x.law.name,
        "place": place_words(x.law),
        "variable": variable_words(x.law),
        "p_value": x.p_value,
        "evidence": x.evidence,
    }


def _cause(f: NamedCause) -> dict[str, Any]:
    return {
        "id": f.name,
        "alternatives": [r.name for r in f.alternatives],
        "p_value": f.p_value,
        "s": f.s,
        "delta_ebic": f.ebic_gain,
        "parameters": {v.name: {"value": v.value, "unit": v.unit, "sd": v.sd, "initial": v.initial} for v in f.values},
        "heldout_gain": f.heldout_gain,
        "heldout_clear": f.heldout_clear,
        "doubtful": f.doubtful,
        "hangs_on": [list(h) for h in f.hangs_on],
        "instead": None if f.instead is None else _law_json(f.instead),
    }


def _misfit(fit: LackOfFit) -> dict[str, Any]:
    return {
        "chi2": fit.square,
        "dof": fit.dof,
        "p_replicates": fit.p_replicates,
        "dof_replicates": fit.free_replicates,
        "trends": [{"variable": t.variable, "p_value": t.p_value, "share": t.share} for t in fit.trends],
    }


def _follow_up(found: FollowUp) -> dict[str, Any]:
    """Chances from 0 to 1; positions in mm."""
    return {
        "visits": len(found.plan.pose),
        "place_before": found.before,
        "place_after": found.after,
        "variable_before": found.variable_before,
        "variable_after": found.variable_after,
        "mounts": [_mount(m) for m in found.mounts],
        "open": [{"explanation": suspect_words(s), "share": s.share} for s in found.suspects],
    }


def foresight_json(found: Foresight) -> dict[str, Any]:
    """What `qsf diagnose` writes of a plan; sizes in SI."""
    return _finite(
        {
            "poses": found.poses,
            "sigma_mm": 1e3 * found.sigma,
            "level": found.level,
            "power": found.power,
            "share": found.share,
            "seed": found.seed,
            "words": list(foresight_words(found)),
            "causes": [_prospect(p) for p in found.prospects],
            "not_tested": [{"id": u.name, "needs": list(u.needs)} for u in found.untested],
            "pairs": [
                {"first": p.first, "second": p.second, "angle_deg": _degrees(p.angle), "s": p.s} for p in found.pairs
            ],
            "groups": [list(g) for g in found.groups],
            "unknown": None if found.unknown is None else _unknown(found.unknown),
        }
    )


def _unknown(found: UnknownOutlook) -> dict[str, Any]:
    return {
        "s": SIZE,
        "place": found.chance,
        "places": [
            {
                "place": place_words(p.place),
                "shown": p.shown,
                "first": p.chance,
                "instead": None if p.instead is None else place_words(p.instead),
                "instead_share": p.instead_chance,
            }
            for p in found.places
        ],
        "mounts": [_mount(m) for m in found.mounts],
    }


def _mount(mount: Mount) -> dict[str, Any]:
    return {
        "kind": "gauge" if mount.along else "reflector",
        "link": mount.marker.link,
        "xyz_mm": [1e3 * float(v) for v in mount.marker.xyz],
        "along": mount.along or None,
        "place_after": mount.chance,
    }


def _prospect(p: Prospect) -> dict[str, Any]:
    return {
        "id": p.name,
        "status": p.status.value,
        "sizes": [
            {
                "parameter": x.parameter.name,
                "unit": x.parameter.unit,
                "s_typical": x.s,
                "detect": x.detect,
                "name": x.name,
                "detect_words": size_words(x, x.detect),
                "name_words": size_words(x, x.name),
            }
            for x in p.sizes
        ],
        "nearest": p.nearest,
        "angle_deg": _degrees(p.angle),
        "aliases": list(p.aliases),
        "reason": why_words(p),
    }


def _space(found: Diagnosis, per_axis: float) -> float:
    """The 3D RMS in mm."""
    return 1e3 * found.rms.in_space(per_axis)


def _degrees(angle: float) -> float:
    return float(np.rad2deg(angle))


def _finite(value: Any) -> Any:
    """The same with nothing in the place of numbers that are not finite."""
    if is_mapping(value):
        return {key: _finite(entry) for key, entry in value.items()}
    if is_list(value):
        return [_finite(entry) for entry in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
