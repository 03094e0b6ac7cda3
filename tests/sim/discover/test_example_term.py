"""The example outside the package: installed as a user would, it is found in shots that have its effect."""

import csv
import io
from pathlib import Path

import numpy as np
import pytest

import truearc.cli.main as truearc
from tests.sim.discover.worlds import FACTS
from tests.sim.few_terms import few_terms
from truearc import sim
from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import ORDINARY, Dataset, Shots, Tracks
from truearc.sim.data.files import load_dataset, save_dataset
from truearc.sim.discover.investigate import discover
from truearc.sim.physics.catalogue import TERMS, Catalogue, effective, flight_terms, terms_of_file
from truearc.sim.physics.flight import path
from truearc.sim.physics.simulate import launch_of, leave, predict

ROOT = Path(sim.__file__).parent.parent
EXAMPLE = ROOT / "examples" / "truearc-hoodflex"
FILE = EXAMPLE / "truearc_hoodflex.py"
SHOTS, FRAMES, FRAME_S = 32, 32, 1.0 / 60.0
RIVALS = few_terms("hood_offset", "wheel_slip", "wind_x", "spin_decay", "release_height")
TRUTH = {"gravity": {"scale": 1.0}, "drag": {"cd": 0.5}, "magnus": {"cl": 0.06}, "hood_flex": {"angle_deg": 3.0}}


def shoot(facts: Rig, among: Catalogue, seed: int = 3) -> Dataset:
    """Tracks of shots whose hood yields, with scatter of the launch and noise of the tracker."""
    rng = np.random.default_rng(seed)
    numbers = {"motor_ratio": rng.uniform(0.35, 0.75, SHOTS), "hood_deg": rng.uniform(40.0, 60.0, SHOTS)}
    shots = Shots(tuple(f"s{k}" for k in range(SHOTS)), numbers, {})
    values = effective(TRUTH, ORDINARY, among)
    exit = leave(facts, values, launch_of(facts, shots), among=among)
    exit = exit._replace(speed_m_s=exit.speed_m_s * np.exp(rng.normal(0.0, 0.01, SHOTS)),
                         elevation_rad=exit.elevation_rad + np.radians(rng.normal(0.0, 0.3, SHOTS)))
    flown = path(facts, flight_terms(TRUTH, among), values, exit, FRAMES, FRAME_S).position_m
    x, y, z = (np.broadcast_to(np.asarray(part), (FRAMES, SHOTS)).T for part in flown)
    shot, frame = np.nonzero(np.logical_and.accumulate(z > 0.0, axis=1))
    noise = rng.normal(0.0, facts.noise.track_m, (3, len(shot)))
    places = (part[shot, frame] + off for part, off in zip((x, y, z), noise, strict=True))
    return Dataset("flexing", facts, shots, Tracks(shot, frame * FRAME_S, *places))


@pytest.fixture(scope="module")
def among() -> Catalogue:
    return Catalogue((*TERMS, *terms_of_file(FILE, TERMS)))


@pytest.fixture(scope="module")
def dataset(among: Catalogue) -> Dataset:
    return shoot(FACTS, among)


def test_discover_names_the_term_that_is_given_to_it(dataset: Dataset, among: Catalogue) -> None:
    found = discover(dataset, terms=[*RIVALS, among.find(["hood_flex"])[0]])
    assert found.finding.verdict == "named" and found.finding.set == ("hood_flex",)
    size = found.finding.what[0].parameters["angle_deg"]
    assert size.low90 - size.sd < TRUTH["hood_flex"]["angle_deg"] < size.high90 + size.sd
    assert found.finding.sentence.startswith("The hood yields to the ball") and "flatter" in found.finding.sentence
    assert {"do": "measure", "instrument": "hood_film",
            "what": "hood angle while a ball passes, on film at 240 frames/s"} in found.finding.next


@pytest.fixture
def heights(among: Catalogue, tmp_path: Path) -> Path:
    """Measured heights at the target instead of tracks."""
    rng = np.random.default_rng(4)
    numbers = {"motor_ratio": rng.uniform(0.5, 0.8, SHOTS), "hood_deg": rng.uniform(45.0, 60.0, SHOTS),
               "distance_m": rng.uniform(1.5, 3.0, SHOTS)}
    shots = Shots(tuple(f"s{k}" for k in range(SHOTS)), numbers, {})
    assert FACTS.target is not None
    off_m = predict(FACTS, TRUTH, shots, among=among).height_m - FACTS.target.centre_height_m
    numbers["miss_height_m"] = off_m + rng.normal(0.0, 0.02, SHOTS)
    save_dataset(tmp_path / "heights", Dataset("heights", FACTS, shots))
    return tmp_path / "heights"


def test_fit_and_predict_know_the_terms_of_a_file(heights, tmp_path, capsys):
    belief, own = tmp_path / "belief.toml", ["--terms-from", str(FILE)]
    fit = ["fit", str(heights), "--terms", "drag,magnus,hood_flex", "-o", str(belief), "--quiet"]
    assert truearc.main(fit) == 2
    assert "no term 'hood_flex'" in capsys.readouterr().err
    assert truearc.main([*fit, *own]) == 0
    assert "angle by which the hood yields at 10 m/s" in capsys.readouterr().out
    forecast = ["predict", str(heights), "--coefficients", str(belief), "--quiet"]
    assert truearc.main(forecast) == 2
    assert f"{belief}: there is no term 'hood_flex'" in capsys.readouterr().err
    assert truearc.main([*forecast, *own]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    told = np.array([float(row["deviation_m"]) for row in rows])
    assert np.std(told - load_dataset(heights).shots.number("miss_height_m")) < 0.04
