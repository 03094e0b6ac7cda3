"""Aim a ball launcher, forecast its shots, and find physics that its simulation lacks.

    import truearc as ta
    week = ta.load_dataset("data/week")
    found = ta.discover(week, seed=0)
    print(found)

Each name is imported on first use: `import truearc` itself loads neither NumPy nor JAX.
"""

import ast as _ast
from importlib import import_module as _import_module
from pathlib import Path as _Path
from typing import Any as _Any

# name -> the module that it is imported from when it is first used: the imports of the stub that static tools read
_MODULES = {name.name: str(line.module) for line in _ast.parse(_Path(__file__).with_suffix(".pyi").read_bytes()).body
            if isinstance(line, _ast.ImportFrom) for name in line.names}
__all__ = sorted(_MODULES)


def __getattr__(name: str) -> _Any:
    if name == "__version__":
        from importlib.metadata import version
        value: _Any = version("truearc")
    elif name in _MODULES:
        module = _MODULES[name]
        value = _import_module(f"{module}.{name}") if name == "paper" else getattr(_import_module(module), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
