"""A plan in words: its proof, and what it predicts."""

from __future__ import annotations

import numpy as np

from qsframework.experiment import Experiment, Plan
from qsframework.experiment.plan import PlanCertificate
from qsframework.information.sensitivities import identified_by
from qsframework.plans.need import Needed
from qsframework.plugin import Array
from qsframework.report.blocks import Mark, Verdict

_SPREAD = float(np.deg2rad(5.0))
"""rad, m: poses of which no joint spreads more stand in one place."""


def certificate_text(plan: Plan) -> str:
    """The proof of a plan in words."""
    c = plan.certificate
    if c is None:
        return "This plan carries no certificate: it was not designed here."
    certified = np.floor(1e7 * c.relaxed_efficiency) / 1e7  # never rounded up
    words = (
        f"{c.criterion}-optimal over {c.candidates} candidates, each a pose {_read(plan)}. The relaxed design "
        f"({c.solver}) is certified to an efficiency of {certified:.7f} by the equivalence theorem; the plan of "
        f"{c.poses} of these poses reaches at least {_chosen(c):.4f} of the best that any plan over them could."
    )
    if c.polished_from is not None:
        share = f"{100 * c.efficiency:.1f} % of the candidate-set optimum"
        words += f" After continuous refinement within the constraints: {share}."
    return " ".join([words, *(f"Note: {note}." for note in c.notes)])


def _read(plan: Plan) -> str:
    """How each candidate is read."""
    load = "" if plan.of_positions.all() else "under one load" + (" or none" if plan.of_positions.any() else "")
    return " ".join(words for words in (load, "from one station" if plan.station else "") if words) or "without a load"


def _chosen(c: PlanCertificate) -> float:
    """Efficiency of the chosen candidates, before their angles were moved."""
    return c.efficiency if c.polished_from is None else c.polished_from


def tip_sizes(plan: Plan) -> list[str]:
    """Predicted tip uncertainty by criterion I after compensation, and before, mm, in words; none of others."""
    c = plan.certificate
    if c is None or c.criterion != "I":
        return []
    said = [f"{1e3 * np.sqrt(c.value):.3f} mm"]
    if c.value_in_base is not None:
        said[0] += f" after the best frame and tool ({1e3 * np.sqrt(c.value_in_base):.2f} mm in the base frame)"
    return said if c.value_before is None else [*said, f"{1e3 * np.sqrt(c.value_before):.3g} mm before"]


def tip_words(plan: Plan) -> list[str]:
    """What the criterion I says in millimetres, and what the readings leave to the frame and the tool."""
    sizes, c = tip_sizes(plan), plan.certificate
    said = (
        [
            f"Predicted tip uncertainty after compensation with a fit of this plan: {', '.join(sizes)}, root mean "
            "square over the test poses."
        ]
        if sizes
        else []
    )
    if c is not None and c.value_in_base is not None:
        said.append(
            "What turns or shifts the whole arm, or its tool, is taken up by the frame and the tool that the readings "
            "give: in the base frame the tip is more certain only where these are stated (`frames:`, nests)."
        )
    return said


def need_words(found: Needed) -> list[str]:
    """Whether a plan reaches the accuracy that was asked for, and what limits it where it does not."""
    count, asked = int(sum(found.plan.repeats)), f"{1e3 * found.accuracy:.3g} mm"
    reached = f"{1e3 * found.reached.max():.3f} mm (k = 2, at point {found.worst + 1})"
    frame = "Positions are meant after the frame and the tool that suit best, where nobody states these."
    if found.enough:
        fewest = f"; over the candidates no plan of fewer than {found.least} poses is allowed and does"
        return [f"{count} poses reach {reached}, {asked} was asked for{fewest}. {frame}"]
    if found.repeatability >= found.accuracy:
        limit = f"the arm's own repeatability alone is {1e3 * found.repeatability:.3f} mm, which no plan reduces"
        return [f"No plan reaches {asked}: {limit}. {count} poses reach {reached}. Ask for more than that."]
    name, share = found.shares[0]
    smaller = f"with its noise {found.sigma:.1f} times smaller the most poses that are allowed would do"
    return [
        f"{asked} is not reached: {count} poses reach {reached}, about {found.poses:.0f} would be needed. The "
        f"instrument limits it: {smaller}. {100 * share:.0f} % of the variance there is of {name}.",
        f"Allow more poses (-n), add markers, a nearer station or a better instrument. {frame}",
    ]


def plan_verdict(experiment: Experiment, plan: Plan, sds: Array, enough: bool = True, free: bool = False) -> Verdict:
    """How many poses, what they tell, the predicted tip uncertainty, and how near the plan is to the best.

    sds (p,): predicted for the fitted parameters; enough: whether it reaches an accuracy that was asked for, if any;
    free: whether nothing counts as known before
    """
    parameters, c, tip = experiment.fit_parameters(), plan.certificate, tip_sizes(plan)
    lost = [p.name for p, sd in zip(parameters, sds, strict=True) if not np.isfinite(sd)]
    held = 0
    if c is not None and plan.of_positions.any():  # a frame that nobody knows leaves some of the geometry to it
        held = len(sds) - len(c.parameters)
        lost = [name for name in lost if name in c.parameters]
    shares = [sd / abs(p.nominal) for p, sd in zip(parameters, sds, strict=True) if p.nominal and np.isfinite(sd)]
    faint = sum(1 for share in shares if share > 1.0)
    near = float(np.ptp(plan.pendant, axis=0).max(initial=0.0))
    mark, word, outcome = Mark.GOOD, "Plan ready", f"identify all {len(sds)} parameters"
    told, asked = identified_by(experiment, plan, free)
    if told < asked:
        outcome = f"identify {told} of {asked} directions"
    if held:
        outcome += f", {held} {'is' if held == 1 else 'are'} held at nominal"
    if lost:
        mark, word = Mark.BAD, "Plan does not identify all parameters"
        outcome = f"identify {len(sds) - len(lost)} of {len(sds)} parameters, not {', '.join(lost[:3])}"
    elif faint or near < _SPREAD:
        mark, word = Mark.LOOK, "Plan is weak"
        outcome += f", {faint} of them with above 100 % uncertainty" if faint else ""
        alone = ", all at one place: no joint moves by 5 deg, and nothing says whether a fit holds elsewhere"
        outcome += alone if near < _SPREAD else ""
    if not enough:
        mark, word = Mark.BAD, "Accuracy not reached"
    said = [f"{len(plan.pose)} poses {outcome}"]
    numbers = [(str(len(plan.pose)), "poses")]
    if tip:
        said.append(f"predicted tip uncertainty after calibration: {', '.join(tip)}")
        numbers.append((" ".join(tip[0].split()[:2]), "tip after compensation"))
    if c is not None:
        percent = f"{np.floor(1e3 * _chosen(c)) / 10:.1f} %"  # never rounded up
        said.append(f"at least {percent} of the best possible over {c.candidates} candidates")
        numbers.append((f"\u2265 {percent}", "of the best possible"))
    if shares:
        numbers.append((f"{100 * max(shares):.2g} %", "sd of the weakest parameter"))
    return Verdict(mark, word, "; ".join(said) + ".", tuple(numbers))
