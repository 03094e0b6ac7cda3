"""Two names at once, where everything is linear: the pair is the best of all there are, worked out in closed form."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from tests.sim.discover.straight import ASKED, fit_straight
from truearc.sim.discover.model.baseline_fit import BaselineFit
from truearc.sim.discover.select.forward_selection import Search, best_pair, in_company, or_likelier_pair
from truearc.sim.discover.select.selection_step import make_step
from truearc.sim.discover.select.term_ranking import name_terms

PLANTED = {"wind_z.speed_m_s": 1.2, "added_mass.share": 0.8}
BETWEEN = {"drag_wear.share": tuple(PLANTED)}


@pytest.fixture
def fitted() -> BaselineFit:
    """Alone, what lies between the two planted ones explains most."""
    return fit_straight(PLANTED, 5, 400, usual=dict.fromkeys(ASKED, 1.0), between=BETWEEN)


def exact_nats(fitted: BaselineFit, names: tuple[str, ...]) -> float:
    """Log Bayes factor of amplitudes ~ N(0, 1) against none: |Lambda| and the quadratic form of linear regression."""
    evidence = fitted.evidence
    shared = list(range(evidence.first_shared, len(evidence.columns)))

    def half(columns: list[int], prior: np.ndarray) -> float:
        info = evidence.info.sum(0)[np.ix_(columns, columns)] + prior
        score = evidence.score.sum(0)[columns]
        score[-len(shared):] += evidence.pull
        return float(0.5 * score @ np.linalg.solve(info, score) - 0.5 * np.linalg.slogdet(info)[1])

    asked = [evidence.index(name) for name in names]
    prior = np.zeros((len(asked) + len(shared),) * 2)
    prior[:len(asked), :len(asked)] = np.eye(len(asked))
    prior[len(asked):, len(asked):] = evidence.precision
    return half([*asked, *shared], prior) - half(shared, evidence.precision)


def test_the_best_pair_is_found_though_neither_leads(fitted: BaselineFit) -> None:
    naming = name_terms(fitted, lambda done, note: None)
    assert naming.leader == "drag_wear.share"
    pair = best_pair(fitted, naming)
    assert pair is not None
    exact = {names: exact_nats(fitted, names) for names in itertools.combinations(ASKED, 2)}
    best = max(exact, key=lambda names: exact[names])
    assert set(pair.names) == set(best) == set(PLANTED)
    assert pair.log_evidence == pytest.approx(exact[best], abs=0.1)


@pytest.mark.parametrize(("share", "names"), [(0.5, list(PLANTED)), (4.0, ["drag_wear.share"])])
def test_a_pair_stands_where_it_catches_up_with_the_curve(fitted: BaselineFit, share: float, names: list[str]) -> None:
    """The curve has half of the pair's gain over the first name, or four times as much."""
    shots = len(fitted.evidence.rows)
    step = make_step(fitted, shots, None, (), 0, lambda done, note: None)
    pair = best_pair(fitted, step.naming)
    assert pair is not None
    to_gain = (pair.log_evidence - step.refit.log_evidence) / len(step.after)
    outrun = replace(step, unknown=True, outrun=True, free=step.after + share * to_gain)
    steps, size = in_company(fitted, outrun, Search(shots, (), (), 0.05, 0))
    assert sorted(size or {step.naming.leader: 0.0}) == sorted(names)
    assert steps[0].unknown == (share > 1.0)


@pytest.mark.parametrize(("chain", "names"), [
    ({"drag_wear.share": 1.0, "wind_x.speed_m_s": 0.01}, list(PLANTED)), (PLANTED, list(PLANTED))])
def test_a_chain_that_began_with_the_wrong_name_gives_way_to_a_likelier_pair(
        fitted: BaselineFit, chain: dict[str, float], names: list[str]) -> None:
    shots = len(fitted.evidence.rows)
    step = make_step(fitted, shots, None, (), 0, lambda done, note: None)
    steps, size = or_likelier_pair(fitted, (step, step), dict(chain), Search(shots, (), (), 0.05, 0))
    assert sorted(size) == sorted(names)
    assert all(size[name] == pytest.approx(PLANTED[name], abs=0.2) for name in names)
    assert not any(one.unknown for one in steps)
