"""Drops of the SEPIA toolbox: both layouts of its files, what is wrong with bad ones, and the real files."""

from pathlib import Path

import numpy as np
import pytest

import truearc as ta
from truearc.sim.check.check import check_plausible
from truearc.sim.data.importers.registry import load_importers
from truearc.sim.physics.catalogue import BUILT_IN, terms_of_file
from truearc_proof.importers.sepia_drops import import_sepia_drops

TIMES = "1.220e+00 2.015e+00\n1.121e+00 1.726e+00\n"
DROPS = """# R_ball rho_air rho_ball height time sd(time)
 1.2e-1 1.184 84.0 20.0 2.29 0.1
 1.2e-1 1.184 84.0 40.0 3.26 0.1
 3.8e-2 1.184 626.0 20.0 2.01 0.1   % a baseball
"""


def tutorial(folder: Path, times: str = TIMES, heights: str = "5\n10\n", radii: str = "0.1\n0.2\n") -> tuple[str, ...]:
    paths = tuple(str(folder / f"field.{end}") for end in ("dat", "height", "radii"))
    for path, text in zip(paths, (times, heights, radii), strict=True):
        Path(path).write_text(text, encoding="utf-8")
    return paths


def test_a_time_belongs_to_its_radius_and_its_height(tmp_path: Path) -> None:
    dataset = import_sepia_drops(*tutorial(tmp_path))
    times, shots = dataset.times, dataset.shots
    assert times is not None and len(shots) == 4
    assert shots.number("radius_m").tolist() == [0.1, 0.1, 0.2, 0.2]
    assert (dataset.rig.launcher.release_height_m - times.height_m).tolist() == [5.0, 10.0, 5.0, 10.0]
    assert times.t_s.tolist() == [1.22, 2.015, 1.121, 1.726]
    assert shots.text("ball_id") == ("ball1", "ball1", "ball2", "ball2")
    density = shots.number("mass_kg") / (4.0 / 3.0 * np.pi * shots.number("radius_m")**3)
    assert np.ptp(density) < 1e-9


def test_a_table_of_drops_has_its_own_balls_air_and_errors(tmp_path: Path) -> None:
    (tmp_path / "drops.txt").write_text(DROPS, encoding="utf-8")
    dataset = import_sepia_drops(tmp_path / "drops.txt")
    assert dataset.times is not None
    assert dataset.times.sigma_s.tolist() == [0.1] * 3 and dataset.rig.air.density_kg_m3 == 1.184
    assert dataset.shots.number("mass_kg")[2] == pytest.approx(626.0 * 4.0 / 3.0 * np.pi * 0.038**3)
    assert dataset.times.height_m.tolist() == [20.0, 0.0, 20.0]


@pytest.mark.parametrize(("change", "said"), [
    ({"times": "1.2 2.0\n1.1 x\n"}, "field.dat:2"), ({"times": "1.2 2.0\n1.1\n"}, "field.dat:2: has 1 numbers"),
    ({"times": "1.2 2.0\n"}, "has 1 rows of 2"), ({"radii": "0.1\n-0.2\n"}, "radius: -0.2 must be above 0"),
    ({"times": "# nothing\n"}, "has no numbers"), ({"times": "1.2 nan\n1.1 1.7\n"}, "time: nan must be above 0")])
def test_a_bad_file_is_named(tmp_path: Path, change: dict[str, str], said: str) -> None:
    with pytest.raises(ta.InputError, match=said):
        import_sepia_drops(*tutorial(tmp_path, **change))


@pytest.mark.parametrize(("text", "said"), [
    (DROPS.replace("626.0 20.0", "626.0"), "txt:4: has 5 numbers"), ("1 2 3\n", "has 3 columns"),
    (DROPS.replace("1.184 626", "1.100 626"), "one air a dataset")])
def test_a_bad_table_is_named(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "drops.txt").write_text(text, encoding="utf-8")
    with pytest.raises(ta.InputError, match=said):
        import_sepia_drops(tmp_path / "drops.txt")


@pytest.mark.data
def test_the_real_files_are_read_by_the_command_that_is_registered(data_dir: Path) -> None:
    importer, = (one for one in load_importers() if one.name == "sepia-drops")
    folder = data_dir / "real" / "sepia_ball_drop"
    tutorial_files = [str(folder / f"1_field.{end}") for end in ("dat", "height", "radii")]
    for files, drops in ((tutorial_files, 12), ([str(folder / "2_fieldDat12x6gparam.txt")], 12),
                         ([str(folder / "2_fieldDat15x6gparam.txt")], 15)):
        assert importer.takes(files)
        dataset = check_plausible(importer.load(*files))
        assert len(dataset.shots) == drops and dataset.times is not None


@pytest.mark.data
def test_drag_with_the_square_of_the_speed_is_named_and_not_with_the_speed(data_dir: Path) -> None:
    """The truth of these times has v^2; the toolbox's own simulator has v."""
    folder = data_dir / "real" / "sepia_ball_drop"
    dataset = import_sepia_drops(*(folder / f"1_field.{end}" for end in ("dat", "height", "radii")))
    root = Path(__file__).parents[3]
    terms = [*BUILT_IN, *terms_of_file(root / "examples" / "linear_drag.py", BUILT_IN)]
    law = ta.discover(dataset, believe=["gravity"], terms=terms)
    assert law.record.set == ("drag",)
    chance = {one.term: one.probability for one in law.record.what}
    assert chance["linear_drag"] < 0.05
    told = ta.discover(dataset, believe=["gravity", "linear_drag"], terms=terms)
    assert told.verdict == "none" and "so few shots cannot show" in told.sentence
