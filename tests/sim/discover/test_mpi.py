"""Real flights of a real launcher: the lift that the believed model lacks is found, where physics has it."""

from pathlib import Path

import numpy as np
import pytest

from sim.discover.discover import discover
from sim.importers.mpi import import_mpi

pytestmark = pytest.mark.data


def test_backspin_lift_is_found_in_flight_upward_and_with_the_spin(data_dir: Path) -> None:
    dataset = import_mpi(data_dir / "real/mpi_launches.csv", data_dir / "real/mpi_tracks.csv")
    finding = discover(dataset, ("gravity", "drag")).finding
    assert finding.mismatch.found and finding.data.level == "L2"
    where = finding.where
    assert (where.stage, where.direction, where.covariate) == ("flight", "vertical", "exit_spin_rev_s")
    # three sessions, one spin each: an honest answer says that they cannot be told apart
    assert {"session", "wheel_bottom_rad_s"} <= set(where.inseparable)
    assert finding.unknown is not None
    # lift by plain parabolas: mean vertical acceleration of the backspin flights against the others, drag and all
    bent = np.array([2.0 * np.polyfit(dataset.tracks.t_s[here], dataset.tracks.z_m[here], 2)[0]     # type: ignore
                     for here in (dataset.tracks.shot == shot for shot in range(37))])              # type: ignore
    spun = np.array(dataset.shots.text("session")) == "backspin"
    assert finding.unknown.amplitude == pytest.approx(bent[spun].mean() - bent[~spun].mean(), rel=0.2)
    assert finding.data.fitted["tracks"]["drag.cd"] == pytest.approx(0.45, abs=0.07)     # a smooth sphere
