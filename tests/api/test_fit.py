"""Fits through the API: equal to the command, with intervals, tables and clear refusals."""

import pytest

import truearc as ta
from tests.sim.infer.independent import make_dataset
from truearc.cli.main import main

TERMS = ("drag", "magnus", "exit_efficiency")


@pytest.fixture(scope="module")
def week():
    return make_dataset(11, 32, side=True)


@pytest.mark.slow
def test_fit_equals_what_the_command_prints_and_writes(week, tmp_path, capsys) -> None:
    ta.save_dataset(tmp_path / "d", week)
    out = tmp_path / "coefficients.toml"
    assert main(["fit", str(tmp_path / "d"), "--terms", ",".join(TERMS), "-o", str(out), "--quiet"]) == 0
    fit = ta.fit(ta.load_dataset(tmp_path / "d"), [one for one in ta.catalogue() if one.name in TERMS])
    assert capsys.readouterr().out == f"{fit}\n" and fit._repr_html_().startswith("<pre>fitted to 32")
    fit.belief.save(tmp_path / "own.toml")
    assert out.read_bytes() == (tmp_path / "own.toml").read_bytes()
    table = fit.table().to_dict()
    assert {f"{term}.{key}" for term, values in fit.belief.coefficients.items() for key in values} <= set(
        table["parameter"])
    assert all(low < value < high for low, value, high in zip(
        table["low90"], table["value"], table["high90"], strict=True))


@pytest.mark.slow
def test_grid_equals_what_the_command_prints_and_writes(week, tmp_path, capsys) -> None:
    ta.save_dataset(tmp_path / "d", week)
    out = tmp_path / "coefficients.toml"
    assert main(["paper", "fit", str(tmp_path / "d"), "--step", "0.2", "-o", str(out), "--quiet"]) == 0
    grid = ta.fit(ta.load_dataset(tmp_path / "d"), method="grid", step=0.2)
    assert capsys.readouterr().out == f"{grid}\n"
    grid.belief.save(tmp_path / "own.toml")
    assert out.read_bytes() == (tmp_path / "own.toml").read_bytes()
    assert grid.table().rows[0][:2] == (grid.solution.cd, grid.solution.cl)


@pytest.mark.parametrize(("arguments", "message"), [
    ({"terms": ["drag", "magnetism"]}, "terms: there is no term 'magnetism'"), ({"terms": []}, "terms: names no term"),
    ({"terms": "drag"}, "'drag' is one string"), ({"method": "guess"}, "method: there is no 'guess'"),
    ({"method": "grid", "terms": ["drag"]}, "method 'grid' makes no use of them"),
    ({"step": 0.1}, "method 'map' makes no use of it")])
def test_a_fit_that_cannot_be_is_refused(week, arguments, message) -> None:
    with pytest.raises(ta.InputError, match=message):
        ta.fit(week, **arguments)
