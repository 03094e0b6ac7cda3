"""The solver in a process of its own: its refusal of the seals lasts as long as it and holds for no other process."""

import argparse
import subprocess
import sys

from truearc.errors import InputError


def solve_apart(args: argparse.Namespace, out: str) -> None:
    """The solver, in a process of its own."""
    more = ["--processes", str(args.processes)] if args.processes else []
    more += ["--scheduler", args.scheduler] if args.scheduler else []
    more += ["--quiet"] if args.quiet else []
    more += ["--rivals", args.rivals] if args.rivals and args.role is None else []
    done = subprocess.run([sys.executable, "-m", "truearc", "prove", "solve", "--out", out, *more], check=False)
    if done.returncode:
        raise InputError(f"the solver ended with exit code {done.returncode}")
