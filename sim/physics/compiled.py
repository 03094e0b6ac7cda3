"""The law of motion as machine code: the one JAX law of the terms, traced, written out as scalars, compiled by numba.

Only the plane of a flight without sideways force is written out. Nothing here knows what a term says: whatever the
terms of truearc.sim.physics come to is what gets compiled, and an operation that has no counterpart here is an
error.
"""

import hashlib
import importlib.util
import os
import platform
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import jax
import jax.extend
import jax.numpy as jnp
import numba
import numpy as np

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.flight import make_law, needs_time, numbers_of, with_numbers, without_wheels
from truearc.sim.physics.term import BallState, InFlight, Vec, absent

STATE = ("x_m", "z_m", "vx_m_s", "vz_m_s", "spin_rev_s")
CACHED = "cache=True"
LAW, END = "# ---- the law of motion ----\n", "# ---- end of the law ----\n"
INFIX = {"add": "+", "sub": "-", "mul": "*", "div": "/", "pow": "**", "gt": ">", "ge": ">=", "lt": "<", "le": "<=",
         "eq": "==", "ne": "!=", "and": "&", "or": "|", "add_any": "+"}
CALLS = {"sqrt": "math.sqrt", "exp": "math.exp", "log": "math.log", "log1p": "math.log1p", "expm1": "math.expm1",
         "tanh": "math.tanh", "sin": "math.sin", "cos": "math.cos", "tan": "math.tan", "atan2": "math.atan2",
         "abs": "abs", "max": "max", "min": "min", "sign": "np.sign", "floor": "math.floor"}
SAME = ("copy", "copy_p", "convert_element_type", "stop_gradient", "reduce_precision")
NESTED = ("jaxpr", "call_jaxpr", "fun_jaxpr")


class UntraceableLaw(ValueError):
    """The law uses something that this module cannot write out."""


def make_source(rig: Rig, terms: Sequence[InFlight], values: Sequence[tuple[str, str]]) -> str:
    """Source of `acceleration(x_m, z_m, vx_m_s, vz_m_s, spin_rev_s, values, numbers) -> (ax, az)` in m/s2.

    `values`: the (term, parameter) that the function takes as a tuple, in this order; the other parameters have their
    defaults. Numbers of the rig are taken as `numbers`, the tuple that facts_values gives, so that one source serves
    every rig. Raises UntraceableLaw where the law pushes sideways, changes with the time since release, or uses an
    operation without a counterpart.
    """
    rig = without_wheels(rig)
    known = numbers_of(rig)

    def planar(state: tuple[Any, ...], params: tuple[Any, ...], numbers: tuple[Any, ...]) -> tuple[Any, Any]:
        x, z, vx, vz, spin = state
        table: dict[str, dict[str, Any]] = {}
        for (term, parameter), value in zip(values, params, strict=True):
            table.setdefault(term, {})[parameter] = value
        ball = BallState(Vec(x, 0.0, z), Vec(vx, 0.0, vz), Vec(0.0, -1.0 * spin, 0.0))
        law = make_law(with_numbers(rig, iter(numbers)), terms, table)
        if needs_time(law, ball):
            raise UntraceableLaw("the law changes with the time since release, which the grid does not keep")
        pushed = law(ball)
        if not absent(pushed.y):
            raise UntraceableLaw("the law pushes sideways; the grid flies in a plane")
        return jnp.asarray(pushed.x, float), jnp.asarray(pushed.z, float)

    traced = jax.make_jaxpr(planar)((1.0,) * len(STATE), (1.0,) * len(values), (1.0,) * len(known))
    names = (*STATE, *(f"values[{k}]" for k in range(len(values))), *(f"numbers[{k}]" for k in range(len(known))))
    lines, results = _Writer().write(traced.jaxpr, traced.consts, names)
    return (f"def acceleration({', '.join(STATE)}, values, numbers):\n"
            + "".join(f"    {line}\n" for line in lines) + f"    return {results[0]}, {results[1]}\n")


def facts_values(rig: Rig) -> tuple[float, ...]:
    """The rig's numbers in the order in which a written-out law takes them."""
    return numbers_of(without_wheels(rig))


def load_kernel(law: str, template: Path, keep: Callable[[str, str], Path | None] | None = None) -> ModuleType:
    """The module `template`, between its two marks the function of make_source, compiled with its `small`.

    Kept as a file among the user's caches, under a name that its contents determine, since numba keeps machine code
    for files only; where none can be written, it is compiled again in every process. keep: (name, text) -> the file.
    """
    before, _, rest = template.read_text(encoding="utf-8").partition(LAW)
    text = f"{before}@small\n{law}{rest.partition(END)[2]}"
    versions = f"{numba.__version__} {sys.version} {platform.machine()}"
    name = f"truearc_kernel_{hashlib.sha256((versions + text).encode()).hexdigest()[:20]}"
    if name in sys.modules:
        return sys.modules[name]
    path = (keep or _keep)(name, text)
    if path is None:
        module = ModuleType(name)
        exec(compile(text.replace(CACHED, CACHED.replace("True", "False")), name, "exec"), module.__dict__)
    else:
        spec = importlib.util.spec_from_file_location(name, path)
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    sys.modules[name] = module
    return module


def _keep(name: str, text: str) -> Path | None:
    """Write the text where it stays, whole or not at all; None where that cannot be done."""
    try:
        path = Path.home() / ".cache" / "truearc" / f"{name}.py"
        if not (path.is_file() and path.read_text(encoding="utf-8") == text):
            path.parent.mkdir(parents=True, exist_ok=True)
            fresh = path.with_suffix(f".{os.getpid()}")
            fresh.write_text(text, encoding="utf-8")
            os.replace(fresh, path)
        return path
    except (OSError, RuntimeError):
        return None


class _Writer:
    """Writes a traced function as assignments; counts the names it has given."""

    def __init__(self) -> None:
        self.count = 0

    def write(self, jaxpr: Any, consts: Sequence[Any], inputs: Sequence[str]) -> tuple[list[str], list[str]]:
        """(assignments, expressions of the results)."""
        names = dict(zip(jaxpr.invars, inputs, strict=True))
        names.update(zip(jaxpr.constvars, map(_literal, consts), strict=True))
        lines: list[str] = []
        for equation in jaxpr.eqns:
            took = [self._name(names, atom) for atom in equation.invars]
            inner = next((equation.params[key] for key in NESTED if key in equation.params), None)
            if inner is not None:
                closed = inner if isinstance(inner, jax.extend.core.ClosedJaxpr) else None
                more, gave = self.write(closed.jaxpr if closed else inner, closed.consts if closed else (), took)
                lines += more
                names.update(zip(equation.outvars, gave, strict=True))
                continue
            self.count += 1
            lines.append(f"v{self.count} = {_expression(equation, took)}")
            names[equation.outvars[0]] = f"v{self.count}"
        return lines, [self._name(names, atom) for atom in jaxpr.outvars]

    def _name(self, names: dict[Any, str], atom: Any) -> str:
        return _literal(atom.val) if isinstance(atom, jax.extend.core.Literal) else names[atom]


def _literal(value: Any) -> str:
    if np.ndim(value):
        raise UntraceableLaw("the law holds an array; the grid flies single numbers")
    return repr(np.asarray(value).item())


def _expression(equation: Any, took: list[str]) -> str:
    name = equation.primitive.name
    if name in INFIX:
        return f"{took[0]} {INFIX[name]} {took[1]}"
    if name in CALLS:
        return f"{CALLS[name]}({', '.join(took)})"
    if name in SAME:
        return took[0]
    if name in ("neg", "not"):
        return f"-{took[0]}" if name == "neg" else f"not {took[0]}"
    if name in ("square", "integer_pow"):
        power = equation.params.get("y", 2)
        factors = " * ".join([took[0]] * abs(power)) or "1.0"
        return factors if power >= 0 else f"1.0 / ({factors})"
    if name == "select_n" and len(took) == 3:
        return f"{took[2]} if {took[0]} else {took[1]}"
    raise UntraceableLaw(f"the law of motion uses {name!r}, which sim/physics/compiled.py cannot write out yet")
