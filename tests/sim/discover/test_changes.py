"""A believed number that has changed: its change, against a model in which the old value and it are two columns."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from tests.sim.discover.made import column
from tests.sim.discover.straight import ASKED, NAMES, fit_straight, lay_straight, see_straight, take_straight
from truearc.sim.discover.select import posterior as post
from truearc.sim.discover.select.terms import Size, name_terms, posterior_amplitude
from truearc.sim.infer.fit import Fit, amplitudes, climb
from truearc.sim.infer.launcher import Launcher, LauncherFit
from truearc.sim.infer.likelihood.layout import Layout, Point, only_shared
from truearc.sim.infer.likelihood.noise import SCATTERS
from truearc.sim.statistics import Z90

CHANGED, OTHER = "drag.cd", "magnus.cl"
USUAL = 0.05                          # of a change; the belief knows the number about as well
CENTRE = np.array([0.8, 0.4])
CANDIDATES = (*ASKED[:3], ASKED[10])  # terms that may be there instead, or as well


def believe(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(true numbers, their mean and covariance by practice): 40 shots that tell little of the difference."""
    root = np.array([[0.06, 0.0], [0.04, 0.03]])
    truth = CENTRE + root @ rng.normal(size=2)
    slopes = rng.normal(size=(40, 2)) @ np.array([[3.0, 3.0], [1.0, -1.0]])
    precision = np.linalg.inv(root @ root.T)
    covariance = np.linalg.inv(precision + slopes.T @ slopes)
    y = slopes @ truth + rng.normal(size=40)
    return truth, covariance @ (precision @ CENTRE + slopes.T @ y), covariance


def lay(mean: np.ndarray, covariance: np.ndarray) -> Layout:
    """The change of CHANGED, and the candidates, are tested."""
    layout = lay_straight(np.full(len(ASKED), 0.3))
    kept = [layout.columns[ASKED.index(name)] for name in CANDIDATES]
    return replace(layout, columns=(column(CHANGED, "term", usual=USUAL), *kept, *layout.columns[len(ASKED):]),
                   source=np.array([NAMES.index(name) for name in (CHANGED, *CANDIDATES, CHANGED, OTHER)]),
                   precision=np.linalg.inv(covariance), centre=mean)


def play(seed: int, change: float = 0.15, wind: float = 0.0) -> tuple[LauncherFit, np.ndarray, np.ndarray]:
    """(the fit of an event of 150 shots as believed; slopes of its shots by name; y)."""
    rng = np.random.default_rng(seed)
    truth, mean, covariance = believe(rng)
    slopes = rng.normal(size=(150, len(NAMES)))
    y = slopes[:, -2:] @ [truth[0] + change, truth[1]] + rng.normal(size=150)
    y += wind * slopes[:, NAMES.index(CANDIDATES[2])]
    layout = replace(lay(mean, covariance), see=see_straight(slopes))
    model = Launcher(take_straight(y), layout)
    point = climb(model.shared_only(), Point.still(layout, 150, np.zeros(len(NAMES)), np.zeros(len(SCATTERS)))).point
    return Fit(model, point, model.linearise(point)[0]), slopes, y


def two_columns(fitted: LauncherFit, slopes: np.ndarray, y: np.ndarray,
                names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of these amplitudes, then of the old values, by linear regression; all are columns."""
    layout = fitted.model.layout
    usual = [layout.columns[fitted.scores.index(name)].usual for name in names]
    matrix = slopes[:, [NAMES.index(name) for name in (*names, CHANGED, OTHER)]]
    prior = np.zeros((len(names) + 2,) * 2)
    prior[:len(names), :len(names)], prior[len(names):, len(names):] = np.diag(np.square(usual)**-1.0), layout.precision
    covariance = np.linalg.inv(matrix.T @ matrix + prior)
    return covariance @ (matrix.T @ y + prior @ [*np.zeros(len(names)), *layout.centre]), covariance


@pytest.mark.parametrize("names", [(CHANGED,), (CHANGED, CANDIDATES[2]), (CANDIDATES[0],)])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_change_is_that_of_a_column_of_its_own(seed: int, names: tuple[str, ...]) -> None:
    fitted, slopes, y = play(seed, wind=0.5)
    found = fitted.with_terms(names, np.zeros(len(names)))
    assert set(found.names) == set(names)
    mean, covariance = two_columns(fitted, slopes, y, found.names)
    amplitude, sd = amplitudes(found.model.layout, found.names, found.scores.point, found.scores.covariance)
    assert amplitude == pytest.approx(mean[:len(names)], abs=1e-5) and found.amplitude == pytest.approx(amplitude)
    assert sd == pytest.approx(np.sqrt(np.diag(covariance))[:len(names)], rel=1e-4) and (found.sd >= sd - 1e-12).all()
    if names[0] == CHANGED:
        own = found.names.index(CHANGED)
        assert found.value[own] == pytest.approx(mean[own] + mean[len(names)], abs=1e-5)
        assert abs(found.value[own] - found.model.layout.believed[CHANGED] - amplitude[own]) > 0.005    # not the same


def test_a_number_that_was_found_to_have_changed_keeps_its_change_beside_others() -> None:
    fitted, slopes, y = play(3, wind=0.5)
    base = fitted.beside(fitted.with_terms((CHANGED,), np.zeros(1)))
    found = base.with_terms((CANDIDATES[2],), np.zeros(1))
    mean, covariance = two_columns(fitted, slopes, y, (CHANGED, CANDIDATES[2]))
    both = amplitudes(found.model.layout, (CHANGED, CANDIDATES[2]), found.scores.point, found.scores.covariance)
    assert both[0] == pytest.approx(mean[:2], abs=1e-5)
    assert both[1] == pytest.approx(np.sqrt(np.diag(covariance))[:2], rel=1e-4)


def test_ninety_per_cent_intervals_of_a_change_hold_it_in_ninety_per_cent() -> None:
    """Practice, a change and an event drawn 2,000 times; what the new value differs from the old one's mean by, with
    the new value's own standard deviation, is not an interval of the change."""
    rng, held = np.random.default_rng(7), []
    for _ in range(2000):
        truth, mean, covariance = believe(rng)
        change = USUAL * rng.normal()
        slopes = 5.0 * rng.normal(size=(60, 2))
        y = slopes @ [truth[0] + change, truth[1]] + rng.normal(size=60)
        layout = only_shared(lay(mean, covariance), [CHANGED])
        now = np.linalg.inv(layout.precision + slopes.T @ slopes)
        point = now @ (layout.precision @ mean + slopes.T @ y)
        (amplitude,), (sd,) = amplitudes(layout, (CHANGED,), point, now)
        off = [(amplitude - change) / sd, (point[0] - mean[0] - change) / np.sqrt(now[0, 0])]
        held.append(np.abs(off) < Z90)
    right, naive = np.mean(held, axis=0)
    assert right == pytest.approx(0.9, abs=0.02) and naive < 0.85


def test_a_size_over_several_hypotheses_is_that_of_their_mixture() -> None:
    """With the amplitude's own prior: sizes of half, one, two and four times the usual one; by SciPy's quadrature."""
    fitted, name, usual = fit_straight({}, 1, usual={"release_height.above_m": 0.04}), "release_height.above_m", 0.04
    sizes = (Size(0.03, 0.008, 0.6), Size(0.05, 0.012, 0.3), Size(-0.01, 0.02, 0.1))

    def density(x: float, size: Size) -> float:
        wide = np.mean([norm.pdf(x, 0.0, share * usual) for share in (0.5, 1.0, 2.0, 4.0)])
        return float(norm.pdf(x, size.amplitude, size.sd) * wide / norm.pdf(x, 0.0, usual))

    def moment(size: Size, power: int, end: float = 1.0) -> float:
        low, high = size.amplitude - 8.0 * size.sd, min(size.amplitude + 8.0 * size.sd, end)
        return quad(lambda x: x**power * density(x, size), low, high, limit=200)[0] if high > low else 0.0

    def whole(power: int, end: float = 1.0) -> float:
        return sum(size.probability * moment(size, power, end) / moment(size, 0) for size in sizes)

    mean, sd, low, high = posterior_amplitude(fitted, name, sizes)
    assert mean == pytest.approx(whole(1), abs=1e-4) and sd == pytest.approx(np.sqrt(whole(2) - whole(1)**2), abs=1e-4)
    assert [whole(0, low), whole(0, high)] == pytest.approx([0.05, 0.95], abs=0.003)
    assert posterior_amplitude(fitted, name, sizes[:1])[:2] == pytest.approx(
        (moment(sizes[0], 1) / moment(sizes[0], 0), 0.008), abs=4e-4)


def test_hypotheses_have_the_sizes_that_refits_have() -> None:
    """All is linear here, so that sizes on the table and sizes of refits are the same; also of a number's change."""
    fitted = play(4, change=0.15, wind=0.5)[0]
    posterior = post.weigh(fitted, name_terms(fitted, lambda done, note: None), (), ())
    pairs = [one for one in posterior.hypotheses if post.kind_of(one) == "two"]
    assert any(CHANGED in one.names for one in pairs) and len(pairs) > 5
    for one in (*pairs, *(one for one in posterior.hypotheses if post.kind_of(one) == "one")):
        found = fitted.with_terms(one.names, np.zeros(len(one.names)))
        for name, size in zip(one.names, one.sizes, strict=True):
            assert size.amplitude == pytest.approx(found.amplitude[found.names.index(name)], abs=2e-4)
            assert size.sd == pytest.approx(found.sd[found.names.index(name)], rel=0.3)       # or the sandwich's
    sizes = posterior.sizes()[CHANGED]
    alone = next(p for one, p in zip(posterior.hypotheses, posterior.probability, strict=True)
                 if one.names == (CHANGED,))
    assert sum(size.probability for size in sizes) == pytest.approx(1.0)
    assert sizes[0].probability == pytest.approx(alone / posterior.inclusion(beside=True)[CHANGED])


def test_a_name_that_is_all_but_impossible_has_a_size() -> None:
    """Also where its probability is below the smallest number."""
    hypotheses = tuple(post.Hypothesis((name,), None, nats, 0.0, (Size(0.1, 0.2),))
                       for name, nats in (("a.x", 0.0), ("b.x", -2000.0)))
    assert post.Hypotheses(hypotheses, np.array([1.0, 0.0]), {}).sizes()["b.x"] == (Size(0.1, 0.2, 1.0),)
