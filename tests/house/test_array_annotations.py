"""Arrays in signatures and fields of the inference and discovery code declare their shapes."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FILES = [path for room in ("infer", "discover") for path in sorted((ROOT / "sim" / room).rglob("*.py"))]
BARE = {"np.ndarray", "jnp.ndarray", "jax.Array", "Array", "NDArray", "npt.NDArray"}
SHAPED = {"Bool", "Float", "Inexact", "Int", "Num", "Shaped", "UInt"}


def bare_in(source):
    """(line, annotation) of each array without a shape in a signature or a class's field."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef):
            taken = node.args
            own = [*taken.posonlyargs, *taken.args, *taken.kwonlyargs, taken.vararg, taken.kwarg]
            stated = [arg.annotation for arg in own if arg] + [node.returns]
        elif isinstance(node, ast.ClassDef):
            stated = [field.annotation for field in node.body if isinstance(field, ast.AnnAssign)]
        else:
            continue
        found += [(one.lineno, ast.unparse(one)) for one in stated if one is not None and is_bare(one)]
    return found


def is_bare(annotation):
    if ast.unparse(annotation) in BARE:
        return True
    if isinstance(annotation, ast.Subscript) and ast.unparse(annotation.value) in SHAPED:
        return False
    return any(is_bare(part) for part in ast.iter_child_nodes(annotation))


@pytest.mark.parametrize(("source", "count"), [
    ("def f(a: np.ndarray, *rest: Array) -> tuple[Array, int]: ...", 3), ("def f(a: dict[str, Array] | None): ...", 1),
    ('def f(a: Float[Array, " n"], b: Int[Array, " n"] | slice) -> Float[np.ndarray, ""]: ...', 0),
    ("class C:\n    a: Array\n    b: Float[Array, ' n']", 1), ("def f():\n    a: Array = g()", 0),
    ("def f(step: Callable[[Array], float]): ...", 1)])
def test_arrays_without_shapes_are_found(source, count):
    assert len(bare_in(source)) == count


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_arrays_declare_their_shapes(path):
    assert bare_in(path.read_text(encoding="utf-8")) == [], path
