"""Real flights: the lift of a launcher's backspin, the air that slows falling balls."""

from pathlib import Path

import numpy as np
import pytest

from sim.discover.discover import discover
from sim.importers.ball_drops import import_ball_drops
from sim.importers.mpi import import_mpi

pytestmark = [pytest.mark.data, pytest.mark.slow]


def test_backspin_lift_is_named_and_flights_end_where_it_says(data_dir: Path) -> None:
    dataset = import_mpi(data_dir / "real/mpi_launches.csv", data_dir / "real/mpi_tracks.csv")
    finding = discover(dataset, ("gravity", "drag")).finding
    assert finding.mismatch.found and finding.data.level == "L2"
    assert finding.what[0].term == "magnus"
    assert (finding.where.stage, finding.where.direction) == ("flight", "vertical")
    assert finding.where.covariate == "exit_spin_rev_s"
    # three sessions, one spin each: an honest answer says that they cannot be told apart
    assert {"session", "wheel_bottom_rad_s"} <= set(finding.where.inseparable)
    # lift by plain parabolas: what spin adds upward, across flights that leave at about 5 m/s
    assert finding.verdict == "named" and finding.unknown is None and dataset.tracks is not None
    bent = np.array([2.0 * np.polyfit(dataset.tracks.t_s[here], dataset.tracks.z_m[here], 2)[0]
                     for here in (dataset.tracks.shot == shot for shot in range(37))])
    spun = np.array(dataset.shots.text("session")) == "backspin"
    assert bent[spun].mean() > bent[~spun].mean()
    (interval,) = finding.what[0].parameters.values()
    assert interval.low90 > 0.0
    assert finding.fit is not None and finding.fit.gain_per_shot is not None and finding.fit.gain_se is not None
    assert finding.fit.gain_per_shot > 2.0 * finding.fit.gain_se
    assert finding.fit.height_rmse_before_m is not None and finding.fit.height_rmse_after_m is not None
    assert finding.fit.height_rmse_after_m < 0.5 * finding.fit.height_rmse_before_m


def test_the_drag_of_falling_balls_is_named(data_dir: Path) -> None:
    """Smooth and rough balls from 47 m; without drag they would be 7 m lower at the end."""
    finding = discover(import_ball_drops(data_dir / "real/ball_drops.csv"), ("gravity",)).finding
    assert finding.mismatch.found and finding.what[0].term == "drag"
    assert (finding.where.stage, finding.where.direction) == ("flight", "along")
    assert 0.3 < finding.what[0].parameters["cd"].value < 0.8
    assert finding.fit is not None and finding.fit.height_rmse_before_m is not None
    assert finding.fit.height_rmse_before_m > 1.0
