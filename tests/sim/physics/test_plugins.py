"""Terms of third parties: from files, from installed distributions, and in other processes."""

import inspect
import pickle
import subprocess
import sys
from multiprocessing import get_context
from pathlib import Path

import pytest

from tests.sim.physics import own
from truearc.errors import InputError
from truearc.sim.physics.catalogue import TERMS, Catalogue, terms_of_distributions, terms_of_file
from truearc.sim.physics.term import LaunchTerm, Term
from truearc_proof.parallel import fan_out

TEXT = inspect.getsource(own)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "mine.py"
    path.write_text(TEXT, encoding="utf-8")
    return path


def describe(term: Term) -> tuple[str, str, float]:
    """What another process makes of a term: name, class, and the elevation of a level shot after it."""
    assert isinstance(term, LaunchTerm)
    exit = term.leave(None, {"angle_deg": 1.0}, own.Exit(9.0, 0.0, 0.0))     # type: ignore[arg-type]
    return term.name, type(term).__name__, float(exit.elevation_rad)


def test_a_file_gives_its_classes_and_instances_each_once(file: Path) -> None:
    (term,) = terms_of_file(file, TERMS)
    assert (term.name, term.label) == ("flex", "yielding hood") and isinstance(term, LaunchTerm)
    file.write_text(TEXT + "\n\nflex = Flex()\n\n\nclass _Hidden(Flex):\n    pass\n", encoding="utf-8")
    assert [term.name for term in terms_of_file(file, TERMS)] == ["flex"]


def test_a_file_read_again_gives_equal_terms_and_a_changed_one_others(file: Path) -> None:
    first = terms_of_file(file, TERMS)
    assert terms_of_file(file, TERMS) == first
    file.write_text(TEXT.replace("before the losses", "first of all"), encoding="utf-8")
    assert terms_of_file(file, TERMS) != first and hash(Catalogue(first)) == hash(Catalogue(first))


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
        terms_of_file(file, TERMS)
    assert message in str(caught.value) and str(file) in str(caught.value)


def test_a_missing_file_is_named() -> None:
    with pytest.raises(InputError, match=r"nowhere\.py"):
        terms_of_file("nowhere.py", TERMS)


def test_terms_of_a_file_work_in_spawned_processes_even_without_the_file(file: Path) -> None:
    catalogue = Catalogue((*TERMS, *terms_of_file(file, TERMS)))
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
    assert [term.name for term in terms_of_distributions(TERMS)] == ["flex"]
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
        terms_of_distributions(TERMS)
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
