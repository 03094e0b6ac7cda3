"""truearc discover as a user types it: before any data, on a directory, and what it refuses."""

import json
from pathlib import Path

import jax
import pytest

import truearc.cli.main as truearc
from tests.sim.discover.worlds import FACTS
from truearc.sim.compute import keep_compiled
from truearc.sim.data.dataset import Dataset
from truearc.sim.data.files import save_dataset, save_rig
from truearc.sim.discover.identifiability import rehearse

BELIEVED = ("gravity", "drag", "magnus")


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    path = tmp_path / "rig.toml"
    save_rig(path, FACTS)
    return path


def test_before_any_data_a_rig_is_enough(rig: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, page = tmp_path / "out.json", tmp_path / "out.html"
    assert truearc.main(["identifiability", str(rig), "--shots", "64", "--json", str(out), "--report",
                         str(page), "--quiet"]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith("64 shots of this kind (L0)") and "never seen: battery_sag" in shown
    answer = json.loads(out.read_text())
    assert answer["schema"] == "truearc.identifiability/1" and answer["believed"] == list(FACTS.believe.terms)
    assert {one["term"] for one in answer["terms"]} & {"drag", "gravity"} == set()
    assert "rig.toml" in page.read_text() and "data:image/png;base64," in page.read_text()


def test_a_directory_of_settings_is_enough_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    planned = rehearse(FACTS, BELIEVED, "L0", 64)
    bare = Dataset("plan", FACTS, type(planned.shots)(planned.shots.shot_id, planned.shots.numbers, {}))
    save_dataset(tmp_path / "plan", bare)
    assert truearc.main(["identifiability", str(tmp_path / "plan"), "--sides", "--quiet"]) == 0
    assert capsys.readouterr().out.startswith("64 shots of this kind (L0)")


@pytest.mark.parametrize(("words", "message"), [
    (["d", "--false-alarm", "2"], "--false-alarm"),
    (["d", "--seed", "-1"], "--seed"), (["d", "--false-alarm", "0.0004"], "--false-alarm"),
    (["d", "--json", "nowhere/x.json"], "nowhere/x.json: there is no such directory"),
    (["d", "--believe", "gravity,magic"], "--believe"), (["d", "--since", "home"], "--since goes with --belief"),
])
def test_discover_names_the_option_at_fault(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert truearc.main(["discover", *words]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(("words", "message"), [
    (["RIG", "--shots", "3"], "too few"), (["RIG", "--believe", "magic"], "'magic'"),
    (["nowhere.toml"], "nowhere.toml"), (["DIR", "--shots", "30"], "--shots: "),
    (["DIR", "--level", "L1"], "--level: "),
    (["RIG", "--seed", "-1"], "--seed"), (["RIG", "--believe", "gravity,free_push"], "unexplained effect"),
])
def test_identifiability_names_the_option_at_fault(words: list[str], message: str, rig: Path, tmp_path: Path,
                                                   capsys: pytest.CaptureFixture[str]) -> None:
    typed = [{"RIG": str(rig), "DIR": str(tmp_path)}.get(word, word) for word in words]
    assert truearc.main(["identifiability", *typed]) == 2
    assert message in capsys.readouterr().err


def test_compiled_code_is_kept_where_the_user_keeps_things(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = jax.config.jax_compilation_cache_dir
    try:
        jax.config.update("jax_compilation_cache_dir", None)
        blocked = tmp_path / "a file"
        blocked.write_text("")
        monkeypatch.setenv("HOME", str(blocked))
        keep_compiled()
        assert jax.config.jax_compilation_cache_dir is None
        monkeypatch.setenv("HOME", str(tmp_path))
        keep_compiled()
        assert Path(jax.config.jax_compilation_cache_dir).is_relative_to(tmp_path)
        jax.config.update("jax_compilation_cache_dir", str(tmp_path / "mine"))
        keep_compiled()
        assert jax.config.jax_compilation_cache_dir == str(tmp_path / "mine")
    finally:
        jax.config.update("jax_compilation_cache_dir", before)
