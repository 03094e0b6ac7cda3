"""Discovery: is there a mismatch, where is it, what is it, and how much better is a simulation that has it?"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from msgspec import structs

from truearc.errors import InputError
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.discover.adopt import Investigation, judge_adoption
from truearc.sim.discover.decide import decide
from truearc.sim.discover.detect.always_valid import ChangeTest, test_change
from truearc.sim.discover.detect.battery import ALLOWANCE, TERMS, Asked, ReferenceSession
from truearc.sim.discover.detect.covariates import gather_covariates, gather_factors
from truearc.sim.discover.detect.localization import locate
from truearc.sim.discover.detect.score_test import Judged, judge
from truearc.sim.discover.finding import FALSE_ALARM, SIGN_DRAWS
from truearc.sim.discover.report.build_finding import make_finding, silent
from truearc.sim.discover.report.finding_text import say_limits
from truearc.sim.discover.select.effects import Search, Step
from truearc.sim.infer.belief import Belief, launcher_of, ranges_of
from truearc.sim.infer.fit import Fit, climb, fit_believed
from truearc.sim.infer.launcher import Launcher, LauncherFit
from truearc.sim.infer.likelihood.data import every_column, take_in
from truearc.sim.infer.likelihood.layout import Layout, Measured, lay_out
from truearc.sim.infer.likelihood.score_table import ScoreTable
from truearc.sim.physics.catalogue import Catalogue, as_catalogue
from truearc.sim.physics.term import Term
from truearc.sim.printed import Progress

# Circumstances that compare a shot with the whole session: with each further shot they would be others.
OF_SESSION = ("age", "battery", "density", "droop")
LAUNCHED = ("exit_speed_m_s", "exit_deg", "exit_spin_rev_s")


def discover(dataset: Dataset, believed: Sequence[str] | None = None, false_alarm: float = FALSE_ALARM, seed: int = 0,
             progress: Progress = lambda done, note: None, belief: Belief | None = None,
             since: Dataset | None = None, measured: Measured | None = None,
             terms: Iterable[Term] | None = None) -> Investigation:
    """Fit the believed terms, test for misfit, locate it, and name the terms that explain it.

    believed: names of terms, the rig's own list when None; gravity always is. belief: of this very rig, from an earlier
    session: its terms and their posterior are the baseline, and whether one of them has changed is tested, too. since:
    that very session; misfit of the belief there is then not a change (truearc.sim.discover.detect.battery).
    measured: external measurements of terms; they bear on which term it is, not on whether anything is missing. terms:
    the hypotheses to test, such as [*catalogue(), HoodFlex()]; the believed ones are among them; those of the belief,
    else the built-in ones and those of installed distributions, when None. The same data and seed give the same answer.
    InputError for an unknown term, too few shots, outcomes without a target, or a measurement of a believed term.
    """
    among = belief.catalogue if terms is None and belief is not None else as_catalogue(terms)
    names = believed_names(dataset, believed if belief is None else tuple(belief.coefficients), among)
    _check_measured(measured or {}, names)
    dataset, since = dataset.in_order(), None if since is None else since.in_order()
    model = Launcher.of(dataset, names, among, belief)
    model = replace(model, layout=replace(model.layout, measured=measured or {}))
    if not len(model.data.rows):
        return Investigation(silent(dataset, model.data, names, false_alarm, among), catalogue=among)
    fitted = fit_believed(model, lambda done, note: progress(0.3 * done, note))
    home = None if since is None or belief is None else _at_home(since, belief, names, model.layout)
    search = make_search(dataset, false_alarm, seed, home)
    asked, judged = detect(fitted, search, lambda done, note: progress(0.3 + 0.2 * done, note))
    if not asked.tests:
        return Investigation(silent(dataset, model.data, names, false_alarm, among), catalogue=among)
    place = locate(fitted.scores, asked, judged, false_alarm, search.shots, seed)
    steps: tuple[Step, ...] = ()
    if judged.p_any <= false_alarm:
        steps = decide(fitted, place, search, lambda done, note: progress(0.5 + 0.5 * done, note))
    progress(1.0, "done")
    finding = make_finding(dataset, names, fitted, asked, judged, place, steps, search)
    return Investigation(finding, fitted, asked, steps, belief, search, among, ranges_of(dataset.shots),
                         launcher_of(dataset.rig), threshold=judged.threshold(TERMS, false_alarm))


def with_worth(investigation: Investigation) -> Investigation:
    """The same with what is adopted of it, and its finding with what that is worth in points."""
    if not investigation.steps or investigation.fitted is None:
        return investigation
    choice, found = judge_adoption(investigation), investigation.finding
    if new := {name: at for name, at in choice.at_limit.items() if name not in found.data.at_limit}:
        data = structs.replace(found.data, at_limit=found.data.at_limit | new)
        found = structs.replace(found, data=data, sentence=found.sentence + say_limits(new))
    if choice.points is not None:
        found = structs.replace(found, adoption=structs.replace(choice.points, refused=choice.why or None))
    return replace(investigation, finding=found, choice=choice)


def believed_names(dataset: Dataset, believed: Sequence[str] | None, among: Catalogue) -> tuple[str, ...]:
    """Names of the believed terms, gravity first: every flight needs it."""
    given = tuple(dataset.facts.believe.terms if believed is None else believed)
    try:
        among.find(given)
    except InputError as error:
        if believed is not None:
            raise
        raise InputError(f"{dataset.name}: rig.toml: believe.terms: {error}") from error
    return (*among.always, *(name for name in given if name not in among.always))


def _check_measured(measured: Measured, terms: Sequence[str]) -> None:
    for term in sorted({name.partition(".")[0] for name in measured} & set(terms)):
        raise InputError(f"measured: {term} is believed already: put what was measured into rig.toml or the "
                         f"coefficients")


def make_search(dataset: Dataset, false_alarm: float = FALSE_ALARM, seed: int = 0,
                home: ReferenceSession | None = None) -> Search:
    """Return the covariates and settings of a dataset's tests."""
    return Search(len(dataset.shots), gather_covariates(dataset), gather_factors(dataset.shots), false_alarm, seed,
                  home)


def detect(fitted: LauncherFit, search: Search, progress: Progress) -> tuple[Asked, Judged]:
    """All tests of one fit, judged. Without a test nothing is judged."""
    asked = search.ask(fitted)
    judged = judge(asked.scores, [test.family for test in asked.tests], ALLOWANCE, SIGN_DRAWS, search.seed, progress)
    return asked, judged


def _at_home(since: Dataset, belief: Belief, terms: tuple[str, ...], later: Layout) -> ReferenceSession:
    """The belief at its best in the session that it was made from, laid out like the later one."""
    model = Launcher.of(since, terms, later.chain.catalogue, belief, later)
    point = climb(model.shared_only(), model.middle()).point
    return ReferenceSession(Fit(model, point, model.linearise(point)[0]), every_column(since))


def follow_shots(dataset: Dataset, belief: Belief, seed: int = 0) -> ChangeTest:
    """Test the shots of a dataset, in their order, for a change since the belief. Outcomes and heights at the target
    count, tracks do not.

    Raises:
        InputError: no shot has an outcome or height with its distance and launch, or the rig has no target.
    """
    evidence = score_since(dataset, belief)
    if evidence is None:
        raise InputError(f"{dataset.name}: no shot has an outcome or a height, with its distance and its launch")
    return test_change(evidence, seed, told_by_session(belief))


def told_by_session(belief: Belief) -> tuple[str, ...]:
    """Terms that go with what compares a shot with its session, and so with shots to come: no directions of the test.
    """
    return tuple(term.name for term in belief.catalogue if term.follows in OF_SESSION)


def score_since(dataset: Dataset, belief: Belief) -> ScoreTable | None:
    """The score table of a dataset about the belief's mean; None where no shot says anything of the height."""
    dataset = before_flight(dataset.in_order())
    names = believed_names(dataset, tuple(belief.coefficients), belief.catalogue)
    data = take_in(dataset, belief.curves, fewest=1)
    if not len(data.marked):
        return None
    model = Launcher(data, lay_out(data, names, None, belief.catalogue, belief))
    return model.linearise(model.believed())[0]


def before_flight(dataset: Dataset) -> Dataset:
    """The columns known before each flight, and the outcomes: without tracks, and without measured launches of shots
    whose wheels are known."""
    shots = dataset.shots
    by_robot = np.isfinite(shots.number("motor_ratio")) & np.isfinite(shots.number("hood_deg"))
    for wheel in dataset.facts.launcher.wheel if not by_robot.all() else ():
        by_robot |= np.isfinite(shots.number(f"wheel_{wheel.name}_rad_s")) & np.isfinite(shots.number("hood_deg"))
    numbers = {name: np.where(by_robot, np.nan, column) if name in LAUNCHED else column
               for name, column in shots.numbers.items()}
    return replace(dataset, shots=Shots(shots.shot_id, numbers, shots.texts, shots.source), tracks=None)
