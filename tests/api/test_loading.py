"""What `import truearc` and `--help` load, and the names that the package offers."""

import ast
import inspect
import json
import re
import subprocess
import sys
import types
import typing
from pathlib import Path

import pytest

import truearc as ta
from truearc.sim.printed import Printed

HEAVY = {"numpy", "jax", "scipy", "mujoco", "cv2", "cantools", "pandas", "polars", "matplotlib", "pyarrow", "onnx",
         "onnxruntime", "numba", "msgspec"}
UNWANTED = {"jax", "scipy", "mujoco", "cv2", "cantools"}
SHOTS = Path(__file__).parents[2] / "examples" / "spreadsheet"
APART = {("demo.py", "data.files"),              # the demo plays a world, too, and its page has the hash of the shots
         *(("demo_acts.py", module) for module in ("aim.solve", "data.dataset", "discover.investigate", "world.options",
                                                   "world.world"))}
REFERENCE = Path(__file__).parents[1] / "golden" / "reference"


def loaded_by(code: str) -> set[str]:
    """Top-level modules in a fresh process after it has run `code`."""
    script = f"{code}\nimport json, sys\nprint(json.dumps(sorted({{n.partition('.')[0] for n in sys.modules}})))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout.splitlines()[-1]))


def test_import_loads_nothing_heavy() -> None:
    assert not loaded_by("import truearc; dir(truearc)") & HEAVY


def test_a_light_name_loads_nothing_heavy() -> None:
    assert not loaded_by("import truearc; truearc.InputError, truearc.__version__") & UNWANTED


def test_recording_loads_no_companion() -> None:
    assert not loaded_by("import truearc; truearc.Recording") & {"jax", "scipy", "mujoco"}


@pytest.mark.parametrize("path", sorted(REFERENCE.glob("finding-*/finding.json")), ids=lambda path: path.parent.name)
def test_golden_findings_load_without_a_simulation(path: Path) -> None:
    read = json.loads(path.read_text())
    finding = ta.load_finding(path)
    assert (finding.verdict, finding.sentence) == (read["verdict"], read["sentence"])
    assert [one.term for one in finding.effects] == [one["term"] for one in read["what"]]
    assert not loaded_by(f"import truearc; truearc.load_finding({str(path)!r})") & UNWANTED
    assert str(finding).startswith(f"{finding.sentence}\n") and finding._repr_html_().startswith("<p><b>")


PLAIN = {"catalogue", "export_weights", "load_config", "load_rig", "save_dataset"}    # terms, bytes, settings, nothing


@pytest.mark.parametrize("name", sorted(name for name in ta.__all__ if inspect.isfunction(getattr(ta, name))))
def test_a_result_prints_as_a_report(name: str) -> None:
    returned = typing.get_type_hints(getattr(ta, name))["return"]
    kinds = typing.get_args(returned) if isinstance(returned, types.UnionType) else (returned,)
    assert all(isinstance(kind, type) and issubclass(kind, Printed) for kind in kinds) == (name not in PLAIN), returned


def test_every_name_is_there_and_documented() -> None:
    assert dir(ta) == sorted([*ta.__all__, "__version__"])
    for name in ta.__all__:
        value = getattr(ta, name)
        assert getattr(ta, name) is value
        said = inspect.getdoc(value) or ""
        assert said[:1].isupper() and not said.startswith(f"{name}("), name     # not a dataclass's own signature


@pytest.mark.parametrize("name", [name for name in ta.__all__ if inspect.isfunction(getattr(ta, name))])
def test_every_function_says_what_it_takes_and_what_it_raises(name: str) -> None:
    function = getattr(ta, name)
    said = inspect.getdoc(function) or ""
    parameters = [one for one in inspect.signature(function).parameters if one not in ("directory", "path")]
    if len(parameters) > 1 and name != "save_dataset":
        for parameter in parameters:
            assert f"{parameter}:" in said, (name, parameter)
    if parameters:
        assert "Error" in said, name


def test_public_methods_are_documented() -> None:
    for name in ta.__all__:
        kind = getattr(ta, name)
        if inspect.isclass(kind):
            for key, member in vars(kind).items():
                if not key.startswith("_") and (inspect.isfunction(member) or isinstance(member, property)):
                    assert inspect.getdoc(member), f"{name}.{key}"


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'magic'"):
        _ = ta.magic


@pytest.mark.parametrize(("call", "argument", "load"), [
    (lambda: ta.fit("DIR"), "dataset", "load_dataset"), (lambda: ta.discover("DIR"), "dataset", "load_dataset"),
    (lambda: ta.predict("DIR", None), "dataset", "load_dataset"), (lambda: ta.train_gate("DIR", None), "dataset",
                                                                   "load_dataset"),
    (lambda: ta.identifiability("rig.toml"), "rig_or_dataset", "load_rig"),
    (lambda: ta.predict(ta.load_dataset(SHOTS), "coefficients.toml"), "belief", "load_belief"),
    (lambda: ta.train_gate(ta.load_dataset(SHOTS), "coefficients.toml"), "belief", "load_belief"),
    (lambda: ta.design_shots(ta.load_dataset(SHOTS), "finding.json"), "found", "discover"),
])
def test_a_path_is_no_dataset_and_the_message_says_what_loads_it(call, argument: str, load: str) -> None:
    with pytest.raises(ta.InputError, match=rf"^{argument}: is of type str; load it first with truearc\.{load}"):
        call()


@pytest.mark.parametrize("folder", ["truearc", "sim", "model_export", "robot", "proof"])
def test_the_product_calls_no_command_of_its_own(folder: str) -> None:
    """Nothing but `python -m truearc` hands a list of words to the command line."""
    for path in (Path(__file__).parents[2] / folder).rglob("*.py"):
        said = path.read_text(encoding="utf-8")
        assert "cli.main import" not in said or path.name == "__main__.py", path


def test_every_lazy_name_is_one_that_type_checkers_see() -> None:
    tree = ast.parse(Path(ta.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    (exported,) = (node.value for node in tree.body if isinstance(node, ast.Assign))
    assert ast.literal_eval(exported) == ta.__all__ and all(hasattr(ta, name) for name in ta.__all__)


def test_commands_reach_the_engine_through_the_api() -> None:
    """Of the companion they import defaults, texts, tables and pictures; robot commands their own parts of it."""
    helpers = ("compute", "data.import_shots", "data.importers", "data.table", "discover.report", "paper",
               "physics.catalogue", "printed", "report", "statistics")
    root = Path(ta.__file__).parent / "cli"
    for path in (root / name for name in ("demo.py", "demo_acts.py", "gate.py", "paper.py")):
        for module in re.findall(r"from truearc\.sim\.([\w.]+) import", path.read_text(encoding="utf-8")):
            assert module.startswith(helpers) or (path.name, module) in APART, (path.name, module)
