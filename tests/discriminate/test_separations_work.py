"""What would tell alternatives apart costs less than the diagnosis did, by the work that is counted, not by a clock."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import pytest

from qsf_plugins.offaxis_compliance import OffaxisCompliance
from qsframework.diagnose import diagnose
from qsframework.discriminate import alternatives, pair, t_optimal
from qsframework.discriminate.separations import MOST, STATES, effort_for, separations
from qsframework.elastostatics import Model
from tests.diagnose.cases import campaign, measured, quiet


@dataclass
class Work:
    """Columns of states that a model was asked for, poses judged, draws of candidates and exchanges."""

    columns: int = 0
    states: int = 0
    draws: int = 0
    exchanges: int = 0
    inside: bool = False


@contextmanager
def counted() -> Iterator[Work]:
    """The work that is done inside."""
    work = Work()
    with pytest.MonkeyPatch.context() as patch:

        def outermost(name: str) -> None:
            real = getattr(Model, name)

            def asked(self, poses, x=None, names=None, *more, **options):
                if work.inside:
                    return real(self, poses, x, names, *more, **options)
                work.inside, work.states = True, work.states + len(poses)
                work.columns += len(poses) * len(self.names if names is None else names)
                try:
                    return real(self, poses, x, names, *more, **options)
                finally:
                    work.inside = False

            patch.setattr(Model, name, asked)

        for name in ("rates", "position_rates", "position_sensitivity"):
            outermost(name)
        real_draw, real_exchange = pair.generate_candidates, t_optimal.exchange

        def draw(*given):
            work.draws += 1
            return real_draw(*given)

        def exchange(*given):
            work.exchanges += 1
            return real_exchange(*given)

        patch.setattr(pair, "generate_candidates", draw)
        patch.setattr(t_optimal, "exchange", exchange)
        yield work


@pytest.mark.parametrize("count", [14, 30])
def test_it_costs_less_than_the_diagnosis_however_many_names_have_rivals(count: int) -> None:
    hidden = OffaxisCompliance("joint_4", "z")
    truth = {p.name: 0.8 * p.typical for p in hidden.parameters(campaign().robot.facts)}
    readings = measured((hidden,), truth, seed=1, count=count)
    with counted() as before:
        found = diagnose(campaign(), readings, repeats=1)
    tied = [f for f in found.findings if f.alternatives]
    assert tied
    crowd = replace(found, findings=tuple(tied[:1] * (MOST + 2)))
    with counted() as after:
        pairs, missing = separations(crowd)
    assert (len(pairs), missing) == (MOST, ())
    assert all(p.offers for p in pairs)
    kinds = len(list(alternatives.kinds(campaign())))
    assert after.draws <= 1 + kinds, "each kind of reading is drawn once for all pairs"
    assert after.states <= 4 * STATES + 3 * MOST * len(readings.poses)
    assert after.exchanges <= MOST * (1 + kinds)
    # not counted: the diagnosis' exact fits, draws of noise and searches, most of its time; here there is nothing else
    assert after.columns <= 1.5 * before.columns, (after, before)


@pytest.mark.parametrize(("pairs", "count"), [(1, 12), (3, 12), (3, 60)])
def test_the_poses_to_choose_from_are_shared_by_all_pairs(pairs: int, count: int) -> None:
    found = quiet(0)
    effort = effort_for(found, pairs, count)
    loads = len(campaign().loads)
    assert 2 * count <= effort.candidates <= max(STATES // (pairs * loads), 2 * count)
    assert effort_for(found, 1, count).candidates >= effort.candidates
    assert effort.offered >= count
