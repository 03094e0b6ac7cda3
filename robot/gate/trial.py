"""A gate's model tried in a process of its own, which a limit of time or memory can end.

onnxruntime computes while it loads (constants are folded), and nothing can stop it inside a process. The process is
`python -m truearc.robot.gate.model`: it gets the file's bytes on standard input and does all that loading does.
"""

import signal
import subprocess
import sys

from truearc.errors import InputError

# Of computing: starting the process takes 0.6 s of it here, loading 5 ms; a Raspberry Pi 4 is some five times slower.
LIMIT_S = 10
PATIENCE = 12                         # times that, by the clock: the page's process got a twentieth of a busy core
DATA_BYTES = 400 << 20                # that it may ask for: a gate of 65 kB takes 60 MB
_passed: set[str] = set()             # SHA-256 of the files that this process has had tried


def try_gate(path: object, data: bytes, sha256: str) -> None:
    """Try a model, once in a process.

    InputError when it is not a gate, takes too long or too much memory, or crashes.
    """
    if sha256 in _passed:
        return
    command = [sys.executable, "-P", "-m", "truearc.robot.gate.model", str(path), str(LIMIT_S)]
    try:
        done = subprocess.run(command, input=data, capture_output=True, timeout=PATIENCE * LIMIT_S, check=False)
    except subprocess.TimeoutExpired as error:
        raise InputError(f"{path}: takes longer than {PATIENCE * LIMIT_S} s to load and to rate a configuration; is "
                         "this computer overloaded?") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be tried ({error.strerror})") from error
    if done.returncode == -getattr(signal, "SIGXCPU", 0) != 0:
        raise InputError(f"{path}: takes more than {LIMIT_S} s of computing to load and to rate a configuration")
    if done.returncode == 2:
        raise InputError(done.stdout.decode(errors="replace").strip())
    if done.returncode:
        raise InputError(f"{path}: not a usable ONNX model (its trial ended with exit code {done.returncode})")
    _passed.add(sha256)


def limit_self(limit_s: int) -> None:
    """Limit time and data of this process where the system can; whoever waits for it may be gone."""
    try:
        import resource
    except ImportError:
        return
    resource.setrlimit(resource.RLIMIT_DATA, (DATA_BYTES, DATA_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s + 2))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
