"""Help, completion and `import truearc` load no numerical library, so that they answer at once."""

import subprocess
import sys

import pytest

from truearc.cli.main import list_commands

HEAVY = ("cantools", "can", "cv2", "jax", "matplotlib", "mujoco", "numba", "numpy", "onnx", "onnxruntime", "optax",
         "pandas", "pyarrow", "scipy", "serial", "sklearn", "shtab")
# One interpreter: each command's parser in turn, and what is loaded after it.
CODE = f"""
import sys
from truearc.cli.main import main
from truearc.cli.main import make_parser
from truearc.cli.main import list_commands
for command in list_commands():
    make_parser(command).format_help()
    for name in {HEAVY!r}:
        if name in sys.modules:
            print(command.name, name)
            sys.modules.pop(name)
main(["--help"])
print("then", *(name for name in {HEAVY!r} if name in sys.modules))
"""


def run(code: str) -> list[str]:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def test_no_help_loads_a_numerical_library() -> None:
    lines = run(CODE)
    at = next(row for row, line in enumerate(lines) if line.startswith("usage: truearc COMMAND"))
    assert lines[:at] == []
    assert lines[-1] == "then"


def test_the_list_of_commands_imports_no_command_of_ours() -> None:
    loaded = run("import sys; from truearc.cli.main import main; main(['--help']);"
                 "print('loaded', *(name for name in sys.modules if name.startswith('truearc.')))")[-1].split()
    ours = {command.run.partition(":")[0] for command in list_commands() if not command.distribution}
    assert not (ours - {"truearc.cli.main"}) & set(loaded)


@pytest.mark.parametrize("module", ["truearc", "truearc.cli.main"])
def test_import_loads_no_numerical_library(module: str) -> None:
    assert run(f"import sys, {module}; print(*(name for name in {HEAVY!r} if name in sys.modules))") == [""]
