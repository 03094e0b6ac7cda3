"""The shots since a belief, looked at after each: whether something changed, and from which shot on."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from truearc.robot.config.schema import InputError
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.discover.detect.always_valid import ChangeTest, test_change
from truearc.sim.discover.investigate import believed_names
from truearc.sim.infer.baseline_fit import usual_spot
from truearc.sim.infer.belief import Belief
from truearc.sim.infer.likelihood.design_columns import lay_out
from truearc.sim.infer.likelihood.linearization import ParameterLayout, linearise
from truearc.sim.infer.likelihood.prepared_data import Intake, take_in
from truearc.sim.infer.likelihood.score_table import ScoreTable

# Circumstances that compare a shot with the whole session: with each further shot they would be others.
OF_SESSION = ("age", "battery", "density", "droop")
LAUNCHED = ("exit_speed_m_s", "exit_deg", "exit_spin_rev_s")


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
    intake = take_in(dataset, belief.curves, fewest=1)
    if not len(intake.marked):
        return None
    layout = lay_out(intake, names, None, belief.catalogue, belief)
    spot = replace(usual_spot(intake, layout), log_scatter=_scatter(intake, layout))
    return linearise(intake, layout, spot)[0]


def _scatter(intake: Intake, layout: ParameterLayout) -> Float[np.ndarray, " scatters"]:
    """Logs of the scatters as the belief has them."""
    usual = usual_spot(intake, layout).log_scatter
    return np.array([layout.centre[place - layout.first_shared] if place >= 0 else usual[number]
                     for number, place in enumerate(layout.scatters)])


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
