"""Draw concealed worlds, seal their truth, run discovery on their data, open the seals and mark the claims.

Without a role, all roles of a round run; the solver runs in a process of its own that cannot read the seals. A round's
individual roles are seal, solve and grade. An interrupted round continues where it stopped.

The role pack writes a marked round to one file without its data. The role check recreates the data of --worlds worlds
from the opened seals, and compares every hash and mark; with --solve N, the solver also repeats its claims about N of
them.
"""

import argparse

from truearc.cli.common import refuse
from truearc_proof.rivals import RIVALS

GROUP = "proof"
SUMMARY = "test discovery on concealed worlds with sealed truth"
EXAMPLE = "truearc prove --worlds 60 --level L1 --shots 300 --seed-from-entropy --out round/"
DEFAULTS = {"worlds": 60, "level": "L1", "shots": 300, "engines": "foreign,numpy,mujoco", "solve": 0}
DRAWN = ("--worlds", "--level", "--shots", "--engines", "--seed", "--seed-from-entropy")
# The options that each role uses, besides --out and --quiet; all roles together without one.
APPLY = {
    None: (*DRAWN, "--processes", "--rivals"),
    "seal": (*DRAWN, "--processes", "--rivals", "--world", "--data"),
    "solve": ("--processes", "--rivals"),
    "grade": ("--processes", "--so-far"),
    "pack": ("--packed",),
    "check": ("--packed", "--worlds", "--seed", "--solve", "--processes"),
}
OPTIONS = tuple(dict.fromkeys(option for options in APPLY.values() for option in options))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("role", nargs="?", choices=[role for role in APPLY if role],
                        help="one of the roles; all without it")
    parser.add_argument("--out", metavar="ROUND", default="round", help="directory of the round (%(default)s)")
    parser.add_argument("--worlds", type=int, metavar="N", help=f"number of worlds ({DEFAULTS['worlds']})")
    parser.add_argument("--level", help=f"L0, L1 or L2 ({DEFAULTS['level']})")
    parser.add_argument("--shots", type=int, metavar="N", help=f"shots of each world ({DEFAULTS['shots']})")
    parser.add_argument("--engines", help=f"comma-separated ({DEFAULTS['engines']})")
    source = parser.add_mutually_exclusive_group()
    source.add_argument("--seed", type=int, help="that the worlds are drawn from; with check: the sample")
    source.add_argument("--seed-from-entropy", action="store_true", help="draw it (a round that goes on keeps its own)")
    parser.add_argument("--rivals", metavar="NAMES", help=f"put others to the same tracks, too: {', '.join(RIVALS)}")
    parser.add_argument("--so-far", action="store_true", help="with grade: mark what is claimed, and wait for the rest")
    parser.add_argument("--world", metavar="FILE", help="with seal: JSON of what is true of your own world")
    parser.add_argument("--data", metavar="DIR", help="with --world: its dataset")
    parser.add_argument("--packed", metavar="FILE", help="with pack: the .tar.xz to write; with check: to "
                        "unpack into --out")
    parser.add_argument("--solve", type=int, metavar="N", help="with check: solve this number of those worlds "
                        "again, by a process that has their data alone (0)")
    parser.add_argument("--processes", type=int, help="at a time (one a core)")


def main(args: argparse.Namespace) -> int:
    """Return 0 when the round is done, whatever it reports; InputError if anything was tampered with."""
    role = args.role or "playing all roles"
    refuse(args, tuple(option for option in OPTIONS if option not in APPLY[args.role]), f"{role} does not use it")
    for name, value in DEFAULTS.items():
        if getattr(args, name) is None:
            setattr(args, name, value)
    from truearc_proof.cli.prove_roles import play_role
    return play_role(args)
