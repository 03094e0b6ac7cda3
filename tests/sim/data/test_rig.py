"""rig.toml: it reads back, and whatever is wrong is named with its key."""

from pathlib import Path

import pytest

from tests.sim.data.files import FACTS, GOOD, HEADER, RIG, write
from truearc.errors import InputError
from truearc.sim.data.files import load_dataset, load_rig, save_rig


def test_unknown_rig_keys_are_warned_of(tmp_path, capsys):
    load_dataset(write(tmp_path, f"{HEADER}\n{GOOD}\n", rig=RIG + "[believ]\nterms = []\n[air]\ndensty = 1.2\n"))
    warnings = capsys.readouterr().err
    assert "rig.toml: key believ is not known" in warnings
    assert "rig.toml: key air.densty is not known" in warnings


@pytest.mark.parametrize(("old", "new", "message"), [
    ("mass_kg = 0.14", "mass_kg = 0.0", "ball.mass_kg: 0.0 must be above 0"),
    ("mass_kg = 0.14", "mass_kg = nan", "ball.mass_kg: nan is not finite"),
    ("mass_kg = 0.14", "mass_kg = 'light'", "mass_kg"),
    ("mass_kg = 0.14", "", "mass_kg"),
    ("centre_height_m = 2.44", "centre_height_m = 2.44\nthree_half_height_m = 0.5", "target.three_half_height_m"),
    ("[target]", "[world]\ngravity_m_s2 = -9.81\n[target]",
     "world.gravity_m_s2: -9.81 must be above 0; it is a size and points down: write 9.81"),
    ("[target]", '[believe]\nterms = ["drag", "drag"]\n[target]', "believe.terms: 'drag' stands there more than once"),
    ("[target]", "[world]\ngravity_m_s2 = 0\n[target]", "world.gravity_m_s2: 0.0 must be above 0; it is a size"),
    ("[target]", "[air]\ndensity_kg_m3 = -1.0\n[target]", "air.density_kg_m3: -1.0 must not be below 0"),
])
def test_a_bad_rig_is_named(tmp_path, old, new, message):
    with pytest.raises(InputError) as error:
        load_dataset(write(tmp_path, f"{HEADER}\n{GOOD}\n", rig=RIG.replace(old, new)))
    assert "rig.toml" in str(error.value)
    assert message in str(error.value)


def test_a_rig_that_cannot_be_read_is_named_without_the_systems_number(tmp_path):
    (tmp_path / "rig.toml").mkdir()
    with pytest.raises(InputError, match=r"rig\.toml: Is a directory$"):
        load_rig(tmp_path / "rig.toml")
    with pytest.raises(InputError, match=r"none\.toml: No such file or directory$"):
        load_rig(tmp_path / "none.toml")
    (tmp_path / "latin.toml").write_bytes(b"[ball] # f\xfcr\n")
    with pytest.raises(InputError, match=r"latin\.toml: not UTF-8 text$"):
        load_rig(tmp_path / "latin.toml")


def test_a_rig_reads_back(tmp_path):
    save_rig(tmp_path / "rig.toml", FACTS)
    assert load_rig(tmp_path / "rig.toml") == FACTS


def test_a_key_that_is_not_known_is_named_beside_the_one_that_is_missing(tmp_path: Path,
                                                                        capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "rig.toml"
    path.write_text("[ball]\nmass_g = 140\nradius_m = 0.09\n")
    with pytest.raises(InputError, match=r"ball\.mass_kg: missing key"):
        load_rig(path)
    assert "key ball.mass_g is not known" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["ball = 3\n", "[[ball]]\nmass_kg = 1\n", "[launcher]\nwheel = 1\n",
                                  "ball = [1, [2]]\n"])
def test_tables_of_another_kind_are_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=r"rig\.toml:?\d*: "):
        load_rig(path)
