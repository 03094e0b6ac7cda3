"""Earlier spellings of commands: some are forwarded, the others are refused with the new name."""

import argparse
from collections.abc import Callable

# Earlier names that no document promised: the new name is printed.
RENAMED = {"identify": "sysid", "sweep": "paper sweep"}


def forward(argv: list[str]) -> list[str]:
    """Return `argv` in today's spelling; unchanged where it has no earlier one."""
    rewrite = FORWARDED.get(argv[0]) if argv else None
    return argv if rewrite is None else rewrite(argv[1:]) or argv


def _fit(words: list[str]) -> list[str] | None:
    method, rest = _take("--method", words)
    return {"grid": ["paper", "fit", *rest], "ml": ["fit", *rest]}.get(method or "")


def _train(words: list[str]) -> list[str] | None:
    model, rest = _take("--model", words)
    options = {word.partition("=")[0] for word in words}
    simulated = "--coefficients" not in options and options & {"--sim", "--lambda"}
    if model == "physics":
        return ["train", *rest]
    return ["paper", "train", *rest] if model == "network" or (model is None and simulated) else None


def _discover(words: list[str]) -> list[str] | None:
    rig, rest = _take("--identifiability", words)
    return None if rig is None else ["identifiability", rig, *rest]


def _predict_gate(words: list[str]) -> list[str]:
    """The gate came first of the positional arguments, with `-o FILE` anywhere between."""
    out, rest = _take("-o", words)
    out, rest = (out, rest) if out is not None else _take("--out", words)
    gate = next((word for word in rest if not word.startswith("-")), None)
    named = [] if gate is None else ["--gate", gate]
    others = rest if gate is None else [*rest[:rest.index(gate)], *rest[rest.index(gate) + 1:]]
    return ["predict", *named, *others, *([] if out is None else ["-o", out])]


def _take(option: str, words: list[str]) -> tuple[str | None, list[str]]:
    """The value of an option among the words, and the other words; None where it is not among them."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument(option, dest="value", nargs="?")
    known, rest = parser.parse_known_args(words)
    return known.value, rest


FORWARDED: dict[str, Callable[[list[str]], list[str] | None]] = {
    "fit": _fit,
    "train": _train,
    "discover": _discover,
    "predict-gate": _predict_gate,
    "vision": lambda words: [f"vision-{words[0]}", *words[1:]] if words[:1] in (["calibrate"], ["tune"]) else None,
    "synth": lambda words: ["paper", "synth", *words],
    "replay": lambda words: ["session", "replay", *words],
    "convert": lambda words: ["session", "convert", *words],
    "recover": lambda words: ["session", "recover", *words],
}
