"""The catalogue as a value, with terms of distributions and of files: order, names, what a term must declare."""

import inspect
import pickle
import subprocess
import sys
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.sim.physics import own
from tests.sim.physics.own import Flex
from tests.sim.physics.rigs import GUPPY
from truearc.errors import InputError
from truearc.sim.data.dataset import Shots
from truearc.sim.physics import catalogue as cat
from truearc.sim.physics import term as parts
from truearc.sim.physics.catalogue import NAMELESS, TERMS
from truearc.sim.physics.simulate import predict
from truearc_proof.parallel import fan_out

BIG = cat.Catalogue((*TERMS, Flex()))
ORDER = ("hood_offset hood_backlash encoder_scale distance_scale distance_bias vision_latency track_scale track_tilt "
         "track_roll track_clock track_perspective wheel_slip exit_efficiency wheel_droop ball_compression ball_wear "
         "ball_spread battery_sag rapid_fire release_height spin_decay wind_x wind_y wind_z gravity drag magnus "
         "spin_drag drag_reynolds lift_saturation drag_wear air_density air_change buoyancy added_mass "
         "target_height rim_catch backboard_bounce")
TEXT = inspect.getsource(own)


def test_terms_act_in_the_order_they_declare() -> None:
    assert cat.BUILT_IN.names == tuple(ORDER.split())
    assert cat.Catalogue(TERMS[::-1]) == cat.BUILT_IN
    for stage in parts.STAGES:
        places = [term.order[0] for term in TERMS if term.stage == stage]
        assert places == sorted(set(places))


def test_a_further_term_finds_its_place_by_what_it_declares() -> None:
    names = BIG.names
    assert names.index("track_perspective") + 1 == names.index("flex") == names.index("wheel_slip") - 1
    assert cat.find_terms(["drag", "flex"], BIG) == (Flex(), *cat.find_terms(["drag"]))
    assert cat.find_parameter("flex.angle_deg", BIG) is Flex.parameters[0]
    assert BIG.get("flex") == Flex() and BIG.get("free_push") == NAMELESS[-1] and BIG.get("magic") is None


def test_names_that_are_taken_are_refused() -> None:
    for taken in ("drag", "free_push"):
        second = type("Second", (Flex,), {"__doc__": "A law.", "name": taken})
        with pytest.raises(InputError, match=f"Second: there is a term '{taken}' already"):
            cat.Catalogue((*TERMS, second()))


def test_terms_are_equal_by_class_hashable_and_picklable() -> None:
    assert Flex() == Flex() and hash(BIG) == hash(cat.Catalogue((Flex(), *TERMS))) and BIG != cat.BUILT_IN
    assert pickle.loads(pickle.dumps(BIG)) == BIG
    assert repr(Flex()) == "Flex()"


def test_shots_fly_with_a_further_term() -> None:
    shots = Shots(("a", "b"), {"motor_ratio": np.array([0.5, 0.6]), "hood_deg": np.array([50.0, 45.0]),
                               "distance_m": np.array([2.0, 3.0])}, {})
    lower = Shots(shots.shot_id, {**shots.numbers, "hood_deg": shots.numbers["hood_deg"] - 2.0}, {})
    coefficients = {"drag": {"cd": 0.5}}
    flexed = predict(GUPPY, {**coefficients, "flex": {"angle_deg": 2.0}}, shots, among=BIG)
    np.testing.assert_allclose(flexed.height_m, predict(GUPPY, coefficients, lower).height_m, rtol=1e-9)
    with pytest.raises(InputError, match="no term 'flex'"):
        predict(GUPPY, {"flex": {"angle_deg": 2.0}}, shots)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "mine.py"
    path.write_text(TEXT, encoding="utf-8")
    return path


def describe(term: parts.Term) -> tuple[str, str, float]:
    """What another process makes of a term: name, class, and the elevation of a level shot after it."""
    assert isinstance(term, parts.LaunchTerm)
    exit = term.leave(None, {"angle_deg": 1.0}, own.Exit(9.0, 0.0, 0.0))     # type: ignore[arg-type]
    return term.name, type(term).__name__, float(exit.elevation_rad)


def test_a_file_gives_its_classes_and_instances_each_once(file: Path) -> None:
    (term,) = cat.terms_of_file(file, TERMS)
    assert (term.name, term.label) == ("flex", "yielding hood") and isinstance(term, parts.LaunchTerm)
    file.write_text(TEXT + "\n\nflex = Flex()\n\n\nclass _Hidden(Flex):\n    pass\n", encoding="utf-8")
    assert [term.name for term in cat.terms_of_file(file, TERMS)] == ["flex"]


@pytest.mark.parametrize(("text", "message"), [
    ("", "mine.py: defines no term"), ("def (:\n", "mine.py:1: SyntaxError"),
    ("import nowhere_to_be_found\n", "mine.py:1: ModuleNotFoundError"), ("\n\n1 / 0\n", "mine.py:3: ZeroDivisionError"),
    (TEXT.replace("def leave", "def leaf"), "mine.py: TypeError: Can't instantiate abstract class Flex"),
    (TEXT.replace('    direction = "vertical"\n', ""), "mine.py: Flex: direction: None is none of along"),
    (TEXT.replace("class Flex", "class Drag"), "mine.py: Drag: there is a term 'drag' already"),
    (TEXT.replace("    order", "    def __init__(self, n):\n        self.n = n\n\n    order"), "mine.py: TypeError")])
def test_what_a_file_lacks_is_said_with_its_name(text: str, message: str, file: Path) -> None:
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        cat.terms_of_file(file, TERMS)
    assert message in str(caught.value) and str(file) in str(caught.value)


def test_terms_of_a_file_work_in_spawned_processes_even_without_the_file(file: Path) -> None:
    catalogue = cat.Catalogue((*TERMS, *cat.terms_of_file(file, TERMS)))
    (term,) = catalogue.find(["flex"])
    file.unlink()
    assert pickle.loads(pickle.dumps(catalogue)) == catalogue
    with get_context("spawn").Pool(1) as pool:
        said = pool.map(describe, [term])
    assert said == [("flex", "Flex", pytest.approx(-0.0174533, rel=1e-5))]
    assert fan_out(describe, [term, term], workers=2) == said * 2


def install(folder: Path, target: str, module: str = TEXT, name: str = "hood-flex") -> None:
    """A distribution as an installer would leave it: a module, and metadata with the entry point."""
    info = folder / f"{name.replace('-', '_')}-1.2.dist-info"
    info.mkdir(parents=True)
    (folder / "own_terms.py").write_text(module, encoding="utf-8")
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.2\n", encoding="utf-8")
    (info / "entry_points.txt").write_text(f"[truearc.terms]\nmine = {target}\n", encoding="utf-8")


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "own_terms", raising=False)
    return tmp_path


@pytest.mark.parametrize("more", ["", "\nFlex = Flex()\n", "\nFlex = [Flex, Flex()]\n"])
def test_an_entry_point_gives_a_class_an_instance_or_several(more: str, site: Path) -> None:
    install(site, "own_terms:Flex", TEXT + more)
    assert [term.name for term in cat.terms_of_distributions(TERMS)] == ["flex"]
    sys.modules.pop("own_terms", None)


@pytest.mark.parametrize(("target", "text", "message"), [
    ("own_terms:Nothing", TEXT, "AttributeError"),
    ("own_terms:Flex", "import nowhere_to_be_found", "ModuleNotFoundError"),
    ("own_terms:Flex", TEXT.replace('    sentence = "The hood yields to the ball."\n', ""), "Flex: sentence: "),
    ("own_terms:Flex", TEXT.replace("    order", '    name = "drag"\n    order'), "there is a term 'drag' already"),
    ("own_terms:Flex", "Flex = 3", "3: expected an instance of")])
def test_a_broken_distribution_is_named(target: str, text: str, message: str, site: Path) -> None:
    install(site, target, text)
    with pytest.raises(InputError) as caught:
        cat.terms_of_distributions(TERMS)
    assert str(caught.value).startswith(f"hood-flex 1.2: entry point truearc.terms: mine = {target}: ")
    assert message in str(caught.value)
    sys.modules.pop("own_terms", None)


def test_distributions_are_looked_for_when_first_needed_and_never_by_the_robot(site: Path) -> None:
    install(site, "own_terms:Flex", "raise SystemExit('loaded')")
    for module in ("truearc.sim.physics.catalogue", "truearc.robot.runtime"):
        code = f"import sys, {module}; print({{'own_terms', 'truearc.sim.physics'}} & {{*sys.modules}} or 'neither')"
        found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True,
                               env={"PYTHONPATH": f"{site}:{Path(own.__file__).parents[3]}"})
        assert found.stdout.strip() == ("neither" if ".robot." in module else "{'truearc.sim.physics'}")


PRIOR = parts.Prior("linear", 0.0, 1.0, "a reason")


def number(**changed: Any) -> tuple[parts.Parameter, ...]:
    said = {"name": "angle_deg", "unit": "deg", "low": -1.0, "high": 1.0, "default": 0.0, "source": "a source",
            "prior": PRIOR, "meaning": "an angle"}
    return (parts.Parameter(**{**said, **changed}),)


@pytest.mark.parametrize(("changed", "message"), [
    ({"name": "Hood flex"}, "name: 'Hood flex'"), ({"direction": "up"}, "direction: 'up' is none of along"),
    ({"order": (5, "")}, "order: "), ({"sentence": "It bends"}, "full stop"), ({"__doc__": None}, "no docstring"),
    ({"phrase": parts.Phrase("bends", "unbends", 1.0, "")}, "phrase: "), ({"label": ""}, "label: is empty"),
    ({"instrument": None}, "instrument: "), ({"instrument": parts.Instrument("ruler", "a ruler", 0.0)}, "not above 0"),
    ({"follows": "moonlight", "record": "the moon"}, "follows: 'moonlight'"),
    ({"follows": "curve_by"}, "record: is empty"),
    ({"positive": 1.0}, "positive: "), ({"law_sd": 0.0}, "law_sd: "),
    ({"calibration_sd": 0.1}, "calibration_sd: "), ({"parameters": ()}, "parameters: expected a tuple"),
    ({"parameters": (*number(), *number())}, "two have one name"),
    ({"parameters": number(unit="foot")}, "unit: got 'foot'"),
    ({"parameters": number(default=3.0)}, "not within -1.0 to 1.0"), ({"parameters": number(source="")}, "source: is"),
    ({"parameters": number(meaning="")}, "meaning: is empty"), ({"parameters": number(prior=None)}, "has no prior"),
    ({"parameters": number(low=0.5, default=0.6)}, "whose default is 0"),
    ({"parameters": number(prior=parts.Prior("log", -1.0, 1.0, "a reason"))}, "prior: its scale"),
    ({"parameters": number(fit_each_ball=True)}, "by_ball: ")])
def test_wrong_declaration_is_named(changed: dict[str, Any], message: str) -> None:
    wrong = type("Wrong", (Flex,), {"__doc__": "A law.", **changed})
    with pytest.raises(InputError, match=r"^Wrong: ") as caught:
        cat.check_term(wrong())
    assert message in str(caught.value)
