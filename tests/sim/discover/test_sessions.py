"""A session beside an earlier one: its posterior is the prior, misfit of both is no change, a tracker is compared."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from scipy import stats

from tests.sim.discover.made import column, gaussian
from tests.sim.discover.odd_rigs import make_drops
from tests.sim.discover.straight import ASKED, fit_straight, lay_straight
from truearc.robot.config.rig_spec import Site, Tracker
from truearc.sim.data.dataset import Dataset
from truearc.sim.discover.decide import Step, judge_left
from truearc.sim.discover.detect import battery as bat
from truearc.sim.discover.detect.battery import PIECES, Scores, efficient_scores
from truearc.sim.discover.investigate import make_search
from truearc.sim.discover.next_steps import next_steps
from truearc.sim.discover.report import build_finding
from truearc.sim.discover.select.terms import Naming
from truearc.sim.infer.belief import Belief, point_belief
from truearc.sim.infer.fit import fit_believed
from truearc.sim.infer.launcher import Launcher, LauncherFit
from truearc.sim.infer.likelihood.data import every_column, take_in
from truearc.sim.infer.likelihood.layout import inform, lay_out, may_have_moved, widened
from truearc.sim.infer.likelihood.score_table import Column, ScoreTable
from truearc.sim.physics.catalogue import find_terms
from truearc.sim.physics.term import to_scale
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world

COLUMNS: tuple[Column, ...] = tuple(column(name, "shared") for name in (
    "drag.cd", "exit_efficiency.loss", "hood_offset.angle_deg", "scatter.speed", "scatter.elevation_rad",
    "track_scale.share"))
CENTRE, SD = np.array([0.4, 0.1, 0.0, -4.0, -5.0, 0.0]), np.array([0.3, 0.2, 1.0, 1.0, 1.0, 0.05])
LAYOUT = replace(lay_straight(np.ones(len(ASKED))), columns=COLUMNS, precision=np.diag(SD**-2.0), centre=CENTRE)
NAMES = ("hood_offset.angle_deg", "drag.cd", "scatter.elevation_deg", "exit_efficiency.loss")
ROOT = np.random.default_rng(3).normal(size=(4, 4)) * 0.1


@pytest.fixture
def belief() -> Belief:
    coefficients = {"drag": {"cd": 0.5}, "exit_efficiency": {"loss": 0.2}, "hood_offset": {"angle_deg": -1.5}}
    return Belief(coefficients, {"speed": 0.02, "elevation_deg": 0.4}, NAMES, ROOT @ ROOT.T)


def test_what_is_believed_is_the_centre_and_its_doubt_the_prior(belief: Belief) -> None:
    told = inform(LAYOUT, belief)
    centre, precision = told.centre, told.precision
    assert centre == pytest.approx([0.5, 0.2, -1.5, np.log(0.02), np.log(np.radians(0.4)), 0.0])
    # draws on the belief's scales, taken to the columns' units by the scales themselves
    step = 1e-6
    by_unit = [(to_scale(scale, value + step) - to_scale(scale, value - step)) / (2.0 * step)
               for scale, value in (("linear", -1.5), ("log", 0.5), ("linear", 0.0), ("left", 0.2))]
    expected = ROOT @ ROOT.T / np.outer(by_unit, by_unit)
    found = np.linalg.inv(precision)
    order = [2, 0, 4, 1]                                     # NAMES among COLUMNS
    assert found[np.ix_(order, order)] == pytest.approx(expected, rel=1e-4, abs=1e-7)
    # what the belief knows exactly, or not at all, is as wide as before
    assert found[3, 3] == pytest.approx(SD[3]**2) and found[5, 5] == pytest.approx(SD[5]**2)
    assert found[3, order] == pytest.approx(np.zeros(4), abs=1e-9)
    assert [column.name for column in told.columns if column.told] == [COLUMNS[k].name for k in (0, 1, 2, 4)]


def test_a_belief_may_take_a_combination_for_exact(belief: Belief) -> None:
    """Two numbers known only by their sum: no precision is infinite."""
    root = ROOT[:, :1]
    told = inform(LAYOUT, replace(belief, covariance=root @ root.T))
    assert np.isfinite(told.precision).all() and np.linalg.eigvalsh(told.precision).min() > 0.0
    assert told.centre[0] == pytest.approx(0.5)


def test_only_what_a_belief_doubts_can_have_changed(belief: Belief) -> None:
    assert may_have_moved(belief, "drag.cd") == pytest.approx(0.3 * 0.5 * 0.35)        # the catalogue's 0.35 on the log
    assert may_have_moved(belief, "scatter.speed") is None
    assert may_have_moved(belief, "magnus.cl") is None
    assert may_have_moved(point_belief(belief.coefficients), "drag.cd") is None
    assert may_have_moved(None, "drag.cd") is None


def test_a_number_that_may_have_changed_is_known_worse_by_as_much() -> None:
    root = np.random.default_rng(4).normal(size=(3, 3))
    covariance = root @ root.T + np.eye(3)
    expected = covariance + np.diag([0.0, 0.25, 4.0])
    assert np.linalg.inv(widened(np.linalg.inv(covariance), [(1, 0.5), (2, 2.0)])) == pytest.approx(expected)


def test_priors_that_hang_together_are_as_many_observations_as_they_are() -> None:
    """The same as rows of data with the same information, whatever combinations those are of."""
    rng = np.random.default_rng(5)
    slopes = rng.normal(size=(30, 3))
    y = rng.normal(size=30)
    rows, told = rng.normal(size=(2, 2)), np.array([0.7, -1.1])            # two observations of the shared two
    columns = (column("asked"), column("a", "shared"), column("b", "shared"))
    plain = gaussian(y, slopes, columns)
    informed = replace(plain, precision=rows.T @ rows, pull=rows.T @ told)
    weights, each = np.ones((30, 1)), np.arange(30)
    found = efficient_scores(informed, 0, weights, each, 30)
    more = gaussian(np.concatenate([y, told]), np.concatenate([slopes, np.column_stack([np.zeros(2), rows])]), columns)
    whole = efficient_scores(more, 0, np.ones((32, 1)), np.arange(32), 32)
    assert found.psi.sum() == pytest.approx(whole.psi.sum())
    assert found.kappa.sum() == pytest.approx(whole.kappa.sum())
    assert found.psi[:30] == pytest.approx(whole.psi[:30]) and found.kappa[:30] == pytest.approx(whole.kappa[:30])


def leaning(told: bool, pull: float) -> ScoreTable:
    """One asked and one shared column that pull the same way, of the latter a prior with a standard deviation of 1 / 20
    that lies `pull` / 400 off."""
    columns = (column("asked"), replace(column("a", "shared"), told=told))
    return replace(gaussian(np.zeros(30), np.ones((30, 2)), columns), precision=np.array([[400.0]]),
                   pull=np.array([pull]))


def ask(evidence: ScoreTable) -> Scores:
    return efficient_scores(evidence, 0, np.ones((30, 1)), np.arange(30), 30)


def test_what_a_session_told_is_split_without_loss() -> None:
    """So that a test which rests on it has signs to flip: as many pieces as it takes, which add up to the same."""
    split, whole = ask(leaning(True, 30.0)), ask(leaning(False, 30.0))
    assert len(split.psi) == 30 + PIECES and len(whole.psi) == 31
    assert split.psi[30:].sum() == pytest.approx(whole.psi[30, 0])
    assert split.kappa[30:].sum() == pytest.approx(whole.kappa[30, 0])
    # the prior's share of a score is its error, here 30 / 20 standard deviations
    assert abs(whole.psi[30, 0]) == pytest.approx(1.5 * np.sqrt(whole.kappa[30, 0]))


@pytest.mark.parametrize("pull", [0.0, 60.0])
def test_pieces_spread_as_the_error_that_was_stated(pull: float) -> None:
    """Whatever the error happened to be: its pieces' squares add up to about its variance, not to its square."""
    scores = ask(leaning(True, pull))
    assert (scores.psi[30:]**2).sum() == pytest.approx(scores.kappa[30:].sum(), rel=0.5)


LEFT = {"wind_z.speed_m_s": 0.4, "spin_decay.rate_per_s": -0.3}


def asked(later: LauncherFit, home: LauncherFit | None) -> bat.Asked:
    beside = None if home is None else bat.ReferenceSession(home, {})
    return bat.ask_everything(later.scores, (), (), len(later.scores.rows), beside)


def test_what_is_left_over_in_both_sessions_is_no_change() -> None:
    """Alone every session would be an alarm, beside home no more than one in twenty, chance allowed for."""
    alone, beside = [], []
    for seed in range(40):
        home = fit_straight(LEFT, 2 * seed)
        later = fit_straight(LEFT, 2 * seed + 1)
        alone.append(judge_left(asked(later, None), seed).p_any)
        beside.append(judge_left(asked(later, home), seed).p_any)
    assert np.mean(np.array(alone) <= 0.05) > 0.9
    assert sum(p <= 0.05 for p in beside) <= stats.binom.ppf(0.999, 40, 0.05)
    assert stats.kstest(beside, "uniform").pvalue > 0.001


@pytest.mark.parametrize("shots", [100, 400])
def test_what_has_changed_since_is_seen_and_its_size_is_that_of_the_change(shots: int) -> None:
    changed = {**LEFT, "buoyancy.share": 1.0}
    home = fit_straight(LEFT, 1, shots=shots)
    later = fit_straight(changed, 2)
    found = asked(later, home)
    judged = judge_left(found, 0)
    named = [later.scores.columns[test.column].name for test in found.tests]
    amplitude = dict(zip(named, judged.amplitude, strict=True))
    assert judged.p_any < 0.01 and named[int(judged.statistic.argmax())] == "buoyancy.share"
    sd = np.sqrt(1.0 / 200 + 1.0 / shots)                     # of a difference of two means with unit noise
    assert amplitude["buoyancy.share"] == pytest.approx(1.0, abs=4.0 * sd)
    assert all(abs(amplitude[name]) < 4.0 * sd for name in LEFT)


def test_a_small_home_leaves_the_test_as_it_is() -> None:
    """Its noise would drown the session's scores."""
    home = fit_straight({}, 1, shots=20)
    later = fit_straight({"wind_x.speed_m_s": 0.3}, 2)
    alone, beside = (judge_left(asked(later, one), 0) for one in (None, home))
    assert np.allclose(alone.statistic, beside.statistic) and np.allclose(alone.gain, beside.gain)


def test_names_that_were_given_since_are_fitted_at_home_too() -> None:
    home = fit_straight(LEFT, 1)
    given = bat.ReferenceSession(home, {})
    assert given.among(home) is given
    later = fit_straight(LEFT, 1)
    name = "wind_z.speed_m_s"
    there = given.among(later.beside(later.with_terms((name,), np.array([0.1]))))
    assert there is not None and there.index(name) is None and given.index(name) is not None
    assert there.fitted.values[name] == pytest.approx(0.4, abs=0.3)
    assert given.among(later.beside(later.with_terms((name,), np.array([0.1])))) is there


def test_home_is_as_free_to_have_other_balls_as_the_later_session() -> None:
    """So that both fits absorb alike what the belief leaves over; of its numbers home knows nothing yet."""
    intake = take_in(shoot(make_world({}, "L2", 12, 5, side=True)))
    belief = Belief({"drag": {"cd": 0.5}, "magnus": {"cl": 0.2}}, {}, ("drag.cd",), np.array([[1e-4]]))
    later = lay_out(intake, ("gravity", "drag", "magnus"), belief=belief)
    home = lay_out(intake, ("gravity", "drag", "magnus"), belief=belief, later=later)
    balls = later.grouped
    assert balls == home.grouped == 4                         # speed, elevation, drag, lift
    assert later.precision[-balls:, -balls:] == pytest.approx(home.precision[-balls:, -balls:], abs=1e-6)
    drag = [column.name for column in later.columns].index("drag.cd", len(later.columns) - len(later.precision))
    place = drag - len(later.columns)
    assert later.precision[place, place] > 100.0 * home.precision[place, place]


def test_without_tracks_another_rack_moves_a_session_by_its_share_of_the_shots_scatter() -> None:
    """A belief that knows no scatter allows for nothing."""
    intake = take_in(shoot(make_world({}, "L0", 12, 5, side=True)))
    launch = {"speed": 0.02, "elevation_deg": 0.5}
    layouts = [lay_out(intake, ("gravity", "drag"), belief=Belief({"drag": {"cd": 0.5}}, scatter, (), np.zeros((0, 0))))
               for scatter in (launch, {})]
    rng = np.random.default_rng(1)
    racks = [rng.normal(0.0, np.sqrt(0.5) * sd, (20_000, 10)).mean(1).std() for sd in (0.02, np.radians(0.5))]
    assert [layout.grouped for layout in layouts] == [2, 2]
    known, unknown = (layout.groups for layout in layouts)
    assert known is not None and known.scale == pytest.approx(racks, rel=0.03)
    assert unknown is not None and (unknown.scale == 0.0).all()


BELIEF = Belief({"drag": {"cd": 0.5}, "magnus": {"cl": 0.2}}, {}, ("drag.cd", "magnus.cl"), np.diag([1e-4, 1e-4]))


def seen(seed: int, scale: float = 1.0, pitch_deg: float = 0.0, roll_deg: float = 0.0) -> Dataset:
    """Shots through a camera that sees lengths too long, what lies ahead too high, or what lies left too high."""
    dataset = shoot(make_world({}, "L2", 24, seed, side=True))
    assert dataset.tracks is not None
    x, y, z = (scale * one for one in (dataset.tracks.x_m, dataset.tracks.y_m, dataset.tracks.z_m))
    pitch, roll = np.radians([pitch_deg, roll_deg])
    x, z = x * np.cos(pitch) - z * np.sin(pitch), z * np.cos(pitch) + x * np.sin(pitch)
    y, z = y * np.cos(roll) - z * np.sin(roll), z * np.cos(roll) + y * np.sin(roll)
    facts = msgspec.structs.replace(dataset.facts, tracker=Tracker(scale_sd=0.01, tilt_sd_deg=1.0, clock_sd=0.001))
    return replace(dataset, facts=facts, tracks=replace(dataset.tracks, x_m=x, y_m=y, z_m=z))


def fit(dataset: Dataset) -> LauncherFit:
    intake = take_in(dataset)
    return fit_believed(Launcher(intake, lay_out(intake, ("gravity", "drag", "magnus"), belief=BELIEF)))


@pytest.fixture(scope="module")
def home() -> LauncherFit:
    return fit(seen(5))


def test_a_tracker_that_is_the_same_has_no_change(home: LauncherFit) -> None:
    assert bat.compare_trackers(fit(seen(6)), home, 0.05) is None


def test_a_tracker_that_was_compared_is_said_to_be_and_without_tracks_none_was(home: LauncherFit) -> None:
    for dataset, said in ((seen(6), "no change is seen"), (replace(seen(6), tracks=None), "")):
        later = fit(dataset)
        search = make_search(dataset, home=bat.ReferenceSession(home, every_column(seen(5))))
        sentence = build_finding._tracker(later, search)[1]
        assert bat.can_compare(later, home) == bool(said) and said in sentence and bool(sentence) == bool(said)


@pytest.mark.parametrize(("leader", "indoor", "instrument"), [
    ("track_perspective.per_m", True, "ruler_two_heights"), ("drag.cd", False, "anemometer"), ("drag.cd", True, None)])
def test_what_has_no_name_is_measured_by_its_nearest_name_or_the_wind_outdoors(home, leader, indoor, instrument):
    """The fall of a ball is on film already, and in a hall there is no wind to speak of."""
    rig = msgspec.structs.replace(home.model.data.rig, site=Site(indoor=indoor))
    fitted, nobody = replace(home, model=replace(home.model, data=replace(home.model.data, rig=rig))), np.zeros(0)
    step = Step(Naming((), {}, {leader: 0.0}), None, nobody, nobody, nobody, None, (), fitted, unknown=True)
    found = [one["instrument"] for one in next_steps(seen(5), step, None) if "instrument" in one]
    assert found == ([instrument] if instrument else [])


@pytest.mark.parametrize(("known", "leader", "asked"), [
    (False, "wind_z", True), (False, "drag", False), (True, "wind_z", False)])
def test_what_may_be_lift_asks_for_the_spin_where_nobody_knows_it(known: bool, leader: str, asked: bool) -> None:
    """Without spin there is no lift to test, and rising air stands for it."""
    drops = make_drops(14, 2)
    shots = replace(drops.shots, numbers={"exit_spin_rev_s": np.full(14, 2.0)}) if known else drops.shots
    dataset, nobody = replace(drops, shots=shots), np.zeros(0)
    intake = take_in(dataset)
    fitted = fit_believed(Launcher(intake, lay_out(intake, ("gravity", "drag"))))
    name = f"{leader}.{find_terms([leader])[0].parameters[0].name}"
    step = Step(Naming((), {}, {name: 0.0}), None, nobody, nobody, nobody, None, (), fitted, chosen=(name,))
    assert [one.get("record") == "exit_spin_rev_s" for one in next_steps(dataset, step, (leader,))].count(True) == asked


@pytest.mark.parametrize(("changed", "name", "size"), [
    ({"scale": 1.03}, "track_scale.share", 0.03), ({"pitch_deg": 1.0}, "track_tilt.angle_deg", 1.0),
    ({"roll_deg": -2.0}, "track_roll.angle_deg", -2.0)])
def test_what_was_done_to_the_tracker_is_found(home, changed, name, size):
    later = fit(seen(6, **changed))
    found = bat.compare_trackers(later, home, 0.05)
    assert isinstance(found, bat.TrackerChange) and name in found.together
    (one,) = (one for one in found.numbers if one.name == name)
    assert one.change == pytest.approx(size, abs=4.0 * one.sd) and one.sd < 0.3 * abs(size)


def test_a_crosswind_may_be_a_tracker_that_leans(home: LauncherFit) -> None:
    rivals = [one.name for one in bat.rivals_of(fit(seen(6, roll_deg=2.0)), home, "wind_y.speed_m_s")]
    assert rivals[0] == "wind_y.speed_m_s" and "track_roll.angle_deg" in rivals
    assert bat.rivals_of(home, home, "nothing") == ()
