"""Tables of a round of proof, with Wilson 95 % intervals."""

from collections.abc import Callable, Iterable, Sequence

from sim.intervals import wilson
from sim.prove.marking import NULLS, Mark

PLAIN = 50.0                          # lambda, from which what has no name should be told as such (the design)
VERDICTS = ("none", "named", "set", "unknown")
Question = Callable[[Mark], bool | None]


def make_tables(marks: Sequence[Mark]) -> str:
    """Markdown: false alarms, what was found by how plain it was, what was right, and the abstention matrix."""
    return "\n\n".join([_alarms(marks), _ladder(marks), _right(marks), _matrix(marks)])


def follow_up_table(pairs: Sequence[tuple[Mark, Mark]]) -> str:
    """(first, again) of the worlds that were shot again: what the further shots told."""
    rows = ["| worlds shot again | set before | after | first name right before | after | the right name alone before "
            "| after |", "|---|---|---|---|---|---|---|"]
    named = [pair for pair in pairs if pair[0].first is not None]
    if not named:
        return ""
    sizes = [[one.set_size for one in side if one.set_size is not None] for side in zip(*named, strict=True)]
    cells = [f"{sum(side) / len(side):.1f}" if side else "-" for side in sizes]
    for question in (lambda one: one.first, lambda one: bool(one.first) and one.names == one.hidden):
        cells += [said(*share(side, question)) for side in zip(*named, strict=True)]
    return "\n".join([*rows, f"| {len(named)} | {' | '.join(cells)} |"])


def share(marks: Iterable[Mark], question: Question) -> tuple[int, int]:
    """(yes, of) of those that answer."""
    answers = [answer for answer in map(question, marks) if answer is not None]
    return sum(answers), len(answers)


def said(yes: int, of: int) -> str:
    low, high = wilson(yes, of)
    return f"{yes}/{of} = {yes / of:.2f} ({low:.2f}-{high:.2f})" if of else "-"


def _alarms(marks: Sequence[Mark]) -> str:
    rows = ["| worlds in which nothing is missing | false alarms | a name was given |", "|---|---|---|"]
    nulls = [one for one in marks if one.kind in NULLS]
    for title, mine in (("clean", [one for one in nulls if one.kind == "clean" and one.engine == "numpy"]),
                        ("dirty", [one for one in nulls if one.kind == "dirty"]),
                        ("MuJoCo, unchanged", [one for one in nulls if one.engine == "mujoco"]), ("together", nulls)):
        rows.append(f"| {title} | {said(*share(mine, lambda one: one.found))} | "
                    f"{said(*share(mine, lambda one: bool(one.names)))} |")
    return "\n".join(rows)


def _ladder(marks: Sequence[Mark]) -> str:
    """One hidden effect of the catalogue, by lambda."""
    rows = ["| one hidden effect, lambda | found | these data allow | first name right | up to alias | in the set | "
            "stage |", "|---|---|---|---|---|---|---|"]
    single = [one for one in marks if one.kind in ("one", "alias") and one.strength is not None]
    for low, high in ((0.0, 1.0), (1.0, 3.0), (3.0, 7.0), (7.0, 15.0), (15.0, 35.0), (35.0, 100.0), (100.0, 1e9)):
        mine = [one for one in single if one.strength is not None and low <= one.strength < high]
        if mine:
            allowed = [one.allowed[0] for one in mine if one.allowed]
            cells = [said(*share(mine, lambda one: one.found)),
                     f"{sum(allowed) / len(allowed):.2f}" if allowed else "-",
                     *(said(*share(mine, question)) for question in (
                         lambda one: one.first, lambda one: one.alias, lambda one: one.covered, lambda one: one.stage))]
            rows.append(f"| {low:g}-{high:g} | {' | '.join(cells)} |" if high < 1e9 else
                        f"| {low:g} and more | {' | '.join(cells)} |")
    return "\n".join(rows)


def _right(marks: Sequence[Mark]) -> str:
    """Each kind of world in which something is hidden, of those found."""
    rows = ["| hidden | found | stage | first name right | up to alias | in the set | set size | interval holds | "
            "error / least possible, RMS | gain kept |", "|---|---|---|---|---|---|---|---|---|---|"]
    kinds = {"one effect": ("numpy", "one"), "two effects": ("numpy", "two"), "aliases": ("numpy", "alias"),
             "with a decoy": ("numpy", "decoy"), "in no catalogue": ("numpy", "off"),
             "MuJoCo, one thing changed": ("mujoco", "one")}
    for title, (engine, kind) in kinds.items():
        mine = [one for one in marks if (one.engine, one.kind) == (engine, kind)]
        if not mine:
            continue
        errors = [one.error for one in mine if one.error is not None]
        sizes = [one.set_size for one in mine if one.set_size is not None]
        pairs = [(one.gain, one.oracle_gain) for one in mine if one.gain is not None and one.oracle_gain is not None]
        best = sum(oracle for _, oracle in pairs)
        cells = [*(said(*share(mine, question)) for question in (
                     lambda one: one.found, lambda one: one.stage, lambda one: one.first, lambda one: one.alias,
                     lambda one: one.covered)),
                 f"{sum(sizes) / len(sizes):.1f}" if sizes else "-", said(*share(mine, lambda one: one.holds)),
                 f"{(sum(error**2 for error in errors) / len(errors))**0.5:.2f}" if errors else "-",
                 f"{sum(gain for gain, _ in pairs) / best:.2f}" if best > 0.0 else "-"]
        rows.append(f"| {title} | {' | '.join(cells)} |")
    return "\n".join(rows)


def _matrix(marks: Sequence[Mark]) -> str:
    """What was true against what was said."""
    rows = [f"| true, said | {' | '.join(VERDICTS)} |", "|---|" + "---|" * len(VERDICTS)]
    groups = {"nothing": NULLS, "one of the catalogue": ("one", "decoy"), "aliases": ("alias",), "two": ("two",),
              "in no catalogue": ("off",)}
    for title, kinds in groups.items():
        mine = [one for one in marks if one.kind in kinds]
        if mine:
            rows.append(f"| {title} | {' | '.join(str(sum(one.verdict == word for one in mine)) for word in VERDICTS)} "
                        "|")
    return "\n".join(rows)
