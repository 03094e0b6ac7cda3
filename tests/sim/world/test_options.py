from pathlib import Path

import pytest

from truearc.errors import InputError
from truearc.sim.world.options import Options, load_options


def test_without_a_file_everything_is_at_its_default() -> None:
    assert load_options(None) == Options()


def test_an_empty_file_says_nothing(tmp_path: Path) -> None:
    path = tmp_path / "world.toml"
    path.write_text("# nothing\n", encoding="utf-8")
    assert load_options(path) == Options()


def test_what_the_file_says_is_read_and_the_rest_is_default(tmp_path: Path) -> None:
    path = tmp_path / "world.toml"
    path.write_text("wind_x_m_s = 2\nrelease_arc = true\n", encoding="utf-8")
    assert load_options(path) == Options(wind_x_m_s=2.0, release_arc=True)


@pytest.mark.parametrize(("text", "line", "key"), [
    ("wind_x_m_s = 1.0\nwind_q = 2.0\n", 2, "wind_q"),
    ("\n\nball_mass_scale = -1.0\n", 3, "ball_mass_scale"),
    ("drag_coefficient = nan\n", 1, "drag_coefficient"),
    ("temperature_c = 'warm'\n", 1, "temperature_c"),
    ("wind_y_m_s = inf\n", 1, "wind_y_m_s"),
])
def test_a_wrong_line_is_named(tmp_path: Path, text: str, line: int, key: str) -> None:
    path = tmp_path / "world.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as error:
        load_options(path)
    assert f"{path}:{line}:" in str(error.value)
    assert key in str(error.value)


def test_a_missing_or_broken_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.toml"):
        load_options(tmp_path / "nowhere.toml")
    broken = tmp_path / "broken.toml"
    broken.write_text("wind_x_m_s = \n", encoding="utf-8")
    with pytest.raises(InputError, match=r"broken\.toml.*line 1"):
        load_options(broken)
