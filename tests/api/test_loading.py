"""What `import truearc` and `--help` load, and the names that the package offers."""

import ast
import inspect
import json
import subprocess
import sys
from pathlib import Path

import pytest

import truearc as ta

HEAVY = {"numpy", "jax", "scipy", "mujoco", "cv2", "cantools", "pandas", "polars", "matplotlib", "pyarrow", "onnx",
         "onnxruntime", "numba", "msgspec"}
UNWANTED = {"jax", "scipy", "mujoco", "cv2", "cantools"}
SHOTS = Path(__file__).parents[2] / "examples" / "spreadsheet"
FINDINGS = sorted((Path(__file__).parents[1] / "golden" / "reference").glob("finding-*/finding.json"))


def test_what_is_light_loads_nothing_heavy() -> None:
    """In one fresh process: the package, light names, kept findings, and a recording."""
    code = ("import json, sys, truearc as ta\n"
            "def tell(): print(json.dumps(sorted({n.partition('.')[0] for n in sys.modules})))\n"
            "dir(ta); tell(); ta.InputError, ta.__version__; tell()\n"
            f"[ta.load_finding(path) for path in {[*map(str, FINDINGS)]!r}]; tell(); ta.Recording; tell()")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    package, names, findings, recording = (set(json.loads(line)) for line in done.stdout.splitlines())
    assert FINDINGS and not package & HEAVY and not (names | findings) & UNWANTED
    assert not recording & {"jax", "scipy", "mujoco"}


@pytest.mark.parametrize("path", FINDINGS, ids=lambda path: path.parent.name)
def test_golden_findings_are_read_and_told(path: Path) -> None:
    read = json.loads(path.read_text())
    finding = ta.load_finding(path)
    assert (finding.verdict, finding.sentence) == (read["verdict"], read["sentence"])
    assert [one.term for one in finding.effects] == [one["term"] for one in read["what"]]
    assert str(finding).startswith(f"{finding.change}\n") and finding._repr_html_().startswith("<p><b>")
    assert finding.to_json().encode() == path.read_bytes()
    assert finding.record.mismatch.found == (finding.verdict != "none") and finding.record.data.shots > 0


def test_every_name_is_there_and_documented() -> None:
    assert dir(ta) == sorted([*ta.__all__, "__version__"])
    for name in ta.__all__:
        value = getattr(ta, name)
        assert getattr(ta, name) is value
        said = inspect.getdoc(value) or ""
        assert said[:1].isupper() and not said.startswith(f"{name}("), name     # not a dataclass's own signature


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
    (lambda: ta.design_shots(ta.load_dataset(SHOTS), "finding.json"), "found", "discover")])
def test_a_path_is_no_dataset_and_the_message_says_what_loads_it(call, argument: str, load: str) -> None:
    with pytest.raises(ta.InputError, match=rf"^{argument}: is of type str; load it first with truearc\.{load}"):
        call()


def test_every_lazy_name_is_one_that_type_checkers_see() -> None:
    tree = ast.parse(Path(ta.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    (exported,) = (node.value for node in tree.body if isinstance(node, ast.Assign))
    assert ast.literal_eval(exported) == ta.__all__ and all(hasattr(ta, name) for name in ta.__all__)
