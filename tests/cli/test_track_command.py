"""`truearc track`: clips to a dataset, whole or matched to a recording, and what cannot be used is named."""

from pathlib import Path

import pytest

import truearc as ta
from tests.sim.video.film import Scene, Throw, film
from truearc.cli.main import main

M_PER_PX = 0.1778 / 24.0
BALLS = [Throw(begin_s, begin_s + 0.72, 60.0, 250.0, 330.0, -460.0, 9.81 / M_PER_PX) for begin_s in (0.6, 1.7)]


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("clips") / "monday.mp4"
    film(path, BALLS, 2.6, Scene())
    return path


def test_clip_becomes_tracks_and_an_unreadable_one_is_named(clip, tmp_path, capsys):
    (tmp_path / "broken.mov").write_bytes(b"no film")
    out = tmp_path / "data"
    assert main(["track", str(tmp_path / "broken.mov"), str(clip), "--ball-diameter", "0.1778", "-o", str(out)]) == 2
    said = capsys.readouterr()
    assert "error: " in said.err and "broken.mov: cannot be read as a video" in said.err
    assert said.out.count("monday flight ") == 2 and "scale and clock agree" in said.out
    assert "2 flights in tracks.csv" in said.out
    assert [path.name for path in sorted((out / "flights").iterdir())] == [
        "index.html", "monday-001.jpg", "monday-002.jpg", "monday.jpg"]
    assert main(["track", str(clip), "--ball-diameter", "0.1778", "-o", str(out), "--force",
                 "--without", "monday-002"]) in (0, 1)
    assert "monday-002" not in (out / "tracks.csv").read_text()
    assert "monday flight 2: rejected by the user" in (out / "left_out.txt").read_text()
    assert (out / "shots.csv").read_text().splitlines()[1].startswith("monday-001,0.")


def test_session_gives_flights_its_shots(clip, plain, tmp_path, capsys):
    out = tmp_path / "data"
    assert main(["track", str(clip), "--session", str(plain), "-o", str(out)]) == 1
    assert "not matched: 2 flights and 2 shots have no pattern of times" in capsys.readouterr().out
    assert main(["track", str(clip), "--session", str(plain), "--by-order", "--exit", "60,250", "-o", str(out),
                 "--force"]) == 0
    data = ta.load_dataset(out)
    assert len(data.shots) == 2 and set(data.tracks.shot) == {0, 1}
    assert data.rig.tracker.clock_sd == 0.002
    assert data.tracks.z_m[0] == pytest.approx(data.rig.launcher.release_height_m, abs=0.1)
    assert f"next: truearc discover {out}" in capsys.readouterr().out
    assert main(["discover", str(out), "--quiet"]) == 2 and "2 shots are too few" in capsys.readouterr().err


@pytest.mark.parametrize(("options", "words"), [
    (["--by-order"], "--by-order: applies with --session only"), (["--mark", "1,2"], "expected X,Y=x,z"),
    (["--exit", "left"], "expected a pixel"), (["--tag-size", "0.2"], "no AprilTag"),
    (["--without", "monday-009"], "there is no flight monday-009")])
def test_wrong_options_are_named(clip, tmp_path, capsys, options, words):
    assert main(["track", str(clip), *options, "-o", str(tmp_path / "data")]) == 2
    assert words in capsys.readouterr().err


def test_nothing_readable_leaves_no_folder(tmp_path, capsys):
    assert main(["track", str(tmp_path / "none.mp4"), "-o", str(tmp_path / "data")]) == 2
    assert "none.mp4: No such file" in capsys.readouterr().err
    assert not (tmp_path / "data").exists()
