"""Benchmarks of trackers' faults and of MuJoCo's launcher."""

import numpy as np
import pytest

from benchmarks.faults import FAULTS
from truearc.sim.data.dataset import Tracks
from truearc.sim.physics.catalogue import TERMS
from truearc.sim.physics.term import STAGES
from truearc.sim.world.options import Options
from truearc_proof.rounds.worlds import CHANGES, Change, seen_at

# --- faults

G, SPEED, RATE_HZ = 9.81, 6.0, 50.0


def thrown() -> Tracks:
    """Two flights of 20 frames, without air."""
    t_s = np.tile(np.arange(20) / RATE_HZ, 2)
    return Tracks(np.repeat([0, 1], 20), t_s, SPEED * t_s, 0.5 * t_s, 1.0 + 5.0 * t_s - G * t_s**2 / 2.0)


def pulled(tracks: Tracks) -> float:
    """Downward acceleration of the first flight as the tracker has it."""
    first = tracks.shot == 0
    return -2.0 * np.polyfit(tracks.t_s[first], tracks.z_m[first], 2)[0]


@pytest.mark.parametrize(("fault", "gravity"), [("scale 5 % too long", 1.05 * G), ("clock 5 % slow", G / 1.05**2),
                                                ("turned 5 deg", G)])
def test_gravity_as_the_tracker_has_it(fault: str, gravity: float) -> None:
    assert pulled(FAULTS[fault](thrown())) == pytest.approx(gravity, rel=1e-9)


# --- launcher

@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.name)
def test_a_change_is_one_of_the_world_and_its_names_are_of_the_catalogue(change: Change) -> None:
    changed = Options(**change.options)
    assert (changed == Options()) == (change.name == "nothing")
    assert set(change.names) <= {term.name for term in TERMS}
    assert set(change.stages) <= set(STAGES)
    assert bool(change.names) == bool(change.stages) == bool(change.options)


def test_what_only_tracks_show_is_not_asked_of_outcomes() -> None:
    assert {change.name for change in seen_at("L2")} - {change.name for change in seen_at("L1")} == {"cross_wind"}
