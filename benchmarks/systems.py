"""Benchmark of `truearc.discover(system, runs)`: concealed worlds of five systems, and the same with nothing missing.

    python -m benchmarks.systems --worlds 40 --nulls 40 --seed 6200 --out FILE
    python -m benchmarks.systems --worlds 0 --nulls 40 --runs 8 --parameters 8 --seed 6400 --out FILE
    python -m benchmarks.systems --table FILE

The truth is integrated by SciPy's DOP853 and shares no code with truearc. Each world conceals one of twenty effects, of
which five are in no list of candidates, in runs with fresh numbers and noise. A world counts by the verdict: a false
alarm; a right name in the set; a single name that is right; an interval that holds the size; and, of an effect in no
list, unknown or a set. Targets are those of issue 62; a share meets its target if its exact 95 % interval reaches it.
"""

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.stats import beta

import truearc as ta
from benchmarks.worlds import Line, fill_and_tell, read_args
from truearc.sim.printed import make_text

SAMPLES, HELD = 120, 12                # of a run; samples that an input is held for
Ends = Mapping[str, tuple[float, float]]


class Effect:
    """`rate(x, u, a)`: added to the rates; changed(p, c, a): parameters of a run; seen, driven: signals as distorted.

    names: candidates that say it; none: it is in no list. size: of a, in the candidate's own unit; of a parameter along
    a covariate for a change of `per`, which the runs' own standard deviation replaces.
    """

    def __init__(self, size: float, names: Sequence[str] = (), rate: Any = None, changed: Any = None, seen: Any = None,
                 driven: Any = None, per: float = 0.0) -> None:
        self.size, self.names, self.rate = size, names, rate
        self.changed, self.seen, self.driven, self.per = changed, seen, driven, per


class Kind:
    """A system: its true law, and what is believed of it."""

    def __init__(self, state: Sequence[str], law: Any, true: Mapping[str, float], inputs: Ends, conditions: Ends,
                 begin: Ends,
                 noise: Mapping[str, float], step_s: float, effects: Mapping[str, Effect]) -> None:
        self.state, self.law, self.true, self.inputs, self.conditions = state, law, true, inputs, conditions
        self.begin, self.noise, self.step_s, self.effects = begin, noise, step_s, effects


def _smooth(v: Any, width: float) -> Any:
    return np.tanh(v / width)


def _pendulum(x: Any, u: Any, p: Any) -> list[Any]:
    return [x[1], (u["torque_nm"] - p["c"] * x[1]) / (0.05 * u["mass_kg"]) - p["g"] * np.sin(x[0])]


def _servo(x: Any, u: Any, p: Any) -> list[Any]:
    return [x[1], (p["k"] * (u["goal_rad"] - x[0]) - p["c"] * x[1]) / (p["j"] + 0.04 * u["load_kg"])]


def _tanks(x: Any, u: Any, p: Any) -> list[Any]:
    high, low = (np.sqrt(np.maximum(one, 1e-6)) for one in x)
    return [p["pump"] * u["pump_v"] - p["k1"] * high, p["k1"] * high - p["k2"] * low]


def _spring(x: Any, u: Any, p: Any) -> list[Any]:
    return [x[1], (u["force_n"] - p["k"] * x[0] - p["c"] * x[1]) / u["mass_kg"]]


def _thermal(x: Any, u: Any, p: Any) -> list[Any]:
    return [p["gain"] * u["power_w"] - p["loss"] * (x[0] - u["ambient_c"])]


def _more(k: int, law: Callable[[Any, Any], Any], states: int) -> Any:
    return lambda x, u, a: [a * law(x, u) if n == k else 0.0 for n in range(states)]


KINDS: dict[str, Kind] = {
    "pendulum": Kind(
        ("angle_rad", "speed_rad_s"), _pendulum, {"c": 0.05, "g": 9.0}, {"torque_nm": (-0.4, 0.4)},
        {"mass_kg": (0.5, 1.5), "temperature_c": (15.0, 30.0)}, {"angle_rad": (-0.8, 0.8), "speed_rad_s": (0.0, 0.0)},
        {"angle_rad": 0.003, "speed_rad_s": 0.02}, 0.025, {
            "dry friction": Effect(-0.35, ["speed_rad_s_sign_speed_rad_s"], _more(
                1, lambda x, u: _smooth(x[1], 0.05), 2)),
            "square drag": Effect(-0.25, ["speed_rad_s_square_speed_rad_s"], _more(
                1, lambda x, u: x[1] * np.abs(x[1]), 2)),
            "damping by temperature": Effect(0.25, ["c_with_temperature_c"], changed=lambda p, c, a: {
                **p, "c": p["c"] * np.exp(a * (c["temperature_c"] - 22.5) / 4.33)}, per=4.33),
            "ripple": Effect(0.9, rate=_more(1, lambda x, u: np.sin(9.0 * x[0]), 2))}),
    "servo": Kind(
        ("angle_rad", "speed_rad_s"), _servo, {"k": 6.0, "c": 0.6, "j": 0.03}, {"goal_rad": (-1.0, 1.0)},
        {"load_kg": (0.2, 2.0), "temperature_c": (15.0, 30.0)}, {"angle_rad": (-0.5, 0.5), "speed_rad_s": (0.0, 0.0)},
        {"angle_rad": 0.003, "speed_rad_s": 0.03}, 0.02, {
            "dry friction": Effect(-3.0, ["speed_rad_s_sign_speed_rad_s"], _more(
                1, lambda x, u: _smooth(x[1], 0.1), 2)),
            "friction by load": Effect(-2.5, ["speed_rad_s_load_kg_sign_speed_rad_s"], _more(
                1, lambda x, u: u["load_kg"] * _smooth(x[1], 0.1), 2)),
            "late angle": Effect(0.01, ["angle_rad_output_delay"], seen=("angle_rad", "delay")),
            "rough patch": Effect(-6.0, rate=_more(1, lambda x, u: np.exp(-((x[0] - 0.3) / 0.12)**2) * _smooth(
                x[1], 0.1), 2))}),
    "tanks": Kind(
        ("upper_m", "lower_m"), _tanks, {"pump": 0.05, "k1": 0.12, "k2": 0.1}, {"pump_v": (1.0, 4.0)},
        {"temperature_c": (10.0, 35.0)}, {"upper_m": (0.5, 2.5), "lower_m": (0.5, 3.0)},
        {"upper_m": 0.01, "lower_m": 0.01}, 1.5, {
            "overflow": Effect(-0.12, ["upper_m_above_upper_m"], _more(0, lambda x, u: np.maximum(x[0] - 2.0, 0.0), 2)),
            "leak": Effect(-0.008, ["lower_m_prop_lower_m"], _more(1, lambda x, u: x[1], 2)),
            "late step": Effect(0.08, ["k2_step"], changed=lambda p, c, a: {
                **p, "k2": p["k2"] * np.exp(a * (1.0 if c["run"] > c["last"] / 2 else 0.0))}),
            "slosh": Effect(0.02, rate=_more(1, lambda x, u: np.sin(8.0 * x[0]) * np.cos(5.0 * x[1]), 2))}),
    "spring": Kind(
        ("x_m", "v_m_s"), _spring, {"k": 10.0, "c": 0.4}, {"force_n": (-4.0, 4.0)},
        {"mass_kg": (0.5, 2.0), "humidity": (0.2, 0.8)}, {"x_m": (-0.3, 0.3), "v_m_s": (0.0, 0.0)},
        {"x_m": 0.002, "v_m_s": 0.01}, 0.02, {
            "hardening": Effect(-15.0, ["v_m_s_cubic_x_m"], _more(1, lambda x, u: x[0]**3, 2)),
            "dry friction": Effect(-0.15, ["v_m_s_sign_v_m_s"], _more(1, lambda x, u: _smooth(x[1], 0.02), 2)),
            "speed gain": Effect(0.04, ["v_m_s_output_scale"], seen=("v_m_s", "scale")),
            "detent": Effect(-0.6, rate=_more(1, lambda x, u: np.sin(25.0 * x[0]), 2))}),
    "thermal": Kind(
        ("temp_c",), _thermal, {"gain": 0.02, "loss": 0.01}, {"power_w": (0.0, 60.0)},
        {"ambient_c": (10.0, 30.0), "fan": (0.0, 1.0)}, {"temp_c": (20.0, 60.0)}, {"temp_c": 0.1}, 5.0, {
            "radiation": Effect(-2.5e-7, ["temp_c_cubic_temp_c"], _more(0, lambda x, u: x[0]**3, 1)),
            "loss by fan": Effect(0.06, ["loss_with_fan"], changed=lambda p, c, a: {
                **p, "loss": p["loss"] * np.exp(a * (c["fan"] - 0.5) / 0.289)}, per=0.289),
            "power clipped": Effect(0.5, ["power_w_input_clip_high"], driven=("power_w", 50.0)),
            "latent heat": Effect(-0.15, rate=_more(0, lambda x, u: np.exp(-((x[0] - 55.0) / 3.0)**2), 1))})}
EXTRA = ("a0", "a1", "a2", "a3", "a4", "a5")      # constants that a believed simulator of eight parameters has besides


def believed_rate(kind: Kind, names: Sequence[str]) -> Any:
    """The believed simulator, as a lab writes it; with further numbers that are truly zero."""
    def rate(state: Any, inputs: Any, p: Any) -> Any:
        found = list(kind.law(state, inputs, vars(p)))
        extra = [np.ones_like(state[-1]), state[0], state[0]**2, np.sin(3.0 * state[-1]), state[-1]**2,
                 state[0] * state[-1]]
        for name, shape in zip(names, extra, strict=False):
            found[-1] = found[-1] + getattr(p, name) * shape
        return tuple(found)
    return rate


def system_of(kind: Kind, parameters: int, rng: np.random.Generator) -> "ta.System":
    """Believed: the true numbers, off by a random factor of the prior's width."""
    believed = {name: ta.positive(float(value * np.exp(0.4 * rng.normal())), factor=2)
                for name, value in kind.true.items()}
    size = {"pendulum": 5.0, "servo": 30.0, "tanks": 0.05, "spring": 1.0, "thermal": 0.2}
    extra = EXTRA[:max(parameters - len(believed), 0)] if parameters else ()
    scale = next(size[name] for name, one in KINDS.items() if one is kind)
    believed |= {name: ta.normal(0.0, sd=0.1 * scale) for name in extra}
    return ta.System(rate=believed_rate(kind, extra), state=kind.state, believed=believed,
                     observe=dict.fromkeys(kind.noise))


def table_of(kind: Kind, effect: Effect | None, runs: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Runs of the truth."""
    rows, step = [], kind.step_s
    for run in range(runs):
        conditions = {name: float(rng.uniform(*ends)) for name, ends in kind.conditions.items()}
        t = step * np.arange(SAMPLES)
        inputs = {name: np.repeat(rng.uniform(*ends, SAMPLES // HELD), HELD) for name, ends in kind.inputs.items()}
        driven = dict(inputs)
        numbers = dict(kind.true)
        if effect is not None and effect.driven is not None:
            name, level = effect.driven
            driven[name] = inputs[name] - effect.size * np.maximum(inputs[name] - level, 0.0)
        if effect is not None and effect.changed is not None:
            numbers = effect.changed(numbers, {**conditions, "run": run, "last": runs - 1}, effect.size)
        x = np.array([rng.uniform(*ends) for ends in kind.begin.values()])
        seen = [x]
        for k in range(0, SAMPLES, HELD):
            u = {**{name: values[k] for name, values in driven.items()}, **conditions}

            def law(s: float, y: np.ndarray, u: Any = u, numbers: Any = numbers) -> list[float]:
                rate = kind.law(y, u, numbers)
                more = [0.0] * len(y) if effect is None or effect.rate is None else effect.rate(y, u, effect.size)
                return [a + b for a, b in zip(rate, more, strict=True)]
            found = solve_ivp(law, (0.0, HELD * step), x, method="DOP853", rtol=1e-7, atol=1e-9, max_step=3 * step,
                              t_eval=step * np.arange(1, HELD + 1)).y
            seen, x = [*seen, *found.T], found[:, -1]
        clean = dict(zip(kind.state, np.array(seen[:SAMPLES]).T, strict=True))
        if effect is not None and effect.seen is not None:
            name, how = effect.seen
            clean[name] = (clean[name] * (1.0 + effect.size) if how == "scale" else
                           np.interp(t - effect.size, t, clean[name]))
        noisy = {name: values + kind.noise[name] * rng.normal(size=SAMPLES) for name, values in clean.items()}
        for k in range(SAMPLES):
            rows.append((run, t[k], *(one[k] for one in inputs.values()), *conditions.values(),
                         *(one[k] for one in noisy.values())))
    names = ("run", "t_s", *kind.inputs, *kind.conditions, *kind.state)
    return dict(zip(names, np.array(rows).T, strict=True))


def run(runs: int, parameters: int, job: tuple[str, str, int]) -> Line:
    """One world."""
    name, concealed, seed = job
    kind = KINDS[name]
    effect = kind.effects.get(concealed)
    rng = np.random.default_rng(seed)
    table = table_of(kind, effect, runs, rng)
    begin = time.process_time()
    found = ta.discover(system_of(kind, parameters, rng), ta.Runs(table, inputs=list(kind.inputs),
                                                                conditions=list(kind.conditions)), seed=seed)
    members = found.investigation.model.members if found.investigation.fitted is not None else {}
    named = list(found.record.set or ())
    every = [*named, *(other for one in named for other in members.get(one, ()))]
    right = [one for one in named if effect is not None and {one, *members.get(one, ())} & {*effect.names}]
    holds = None
    if right and effect is not None and right[0] in effect.names:
        size = next(one for one in found.effects if one.term == right[0])
        along = found.investigation.model.labels[right[0]].along
        true = effect.size * (along.width / effect.per if effect.per and along is not None else 1.0)
        holds = bool(size.interval90[0] <= true <= size.interval90[1])
    return {"kind": name, "effect": concealed, "runs": runs, "parameters": parameters, "verdict": found.verdict,
            "set": every, "right": bool(right), "holds": holds, "listed": bool(effect is not None and effect.names),
            "p": found.p_value, "seconds": time.process_time() - begin}


def share(count: int, of: int, low: float, high: float) -> tuple[str, str]:
    """(share with its exact 95 % interval, whether that reaches the target)."""
    if not of:
        return "0 of 0", "not measured"
    ends = (float(beta.ppf(0.025, count, of - count + 1)) if count else 0.0,
            float(beta.ppf(0.975, count + 1, of - count)) if count < of else 1.0)
    said = f"{count} of {of}: {count / of:.0%} ({ends[0]:.0%} to {ends[1]:.0%})"
    return said, "met" if ends[1] >= low and ends[0] <= high else "**missed**"


def make_table(lines: Sequence[Line]) -> str:
    """The rows of issue 62, then the worlds by effect."""
    rows = []
    for runs, parameters in sorted({(line["runs"], line["parameters"]) for line in lines}):
        mine = [line for line in lines if (line["runs"], line["parameters"]) == (runs, parameters)]
        still, listed = [line for line in mine if not line["effect"]], [line for line in mine if line["listed"]]
        off = [line for line in mine if line["effect"] and not line["listed"]]
        found = [line for line in listed if line["verdict"] in ("named", "set")]
        single = [line for line in mine if line["verdict"] == "named"]
        sized = [line for line in listed if line["holds"] is not None]
        detected = [line for line in off if line["verdict"] != "none"]
        case = f"{runs} runs, {parameters or '2-3'} parameters: "
        own = [("false alarms", "3 to 7 %", len([x for x in still if x["verdict"] != "none"]), len(still), 0.03, 0.07),
               ("right name in the set", "90 %", sum(x["right"] for x in found), len(found), 0.9, 1.0),
               ("single names right", "92 %", sum(x["right"] for x in single), len(single), 0.92, 1.0),
               ("intervals hold the size", "84 to 95 %", sum(x["holds"] for x in sized), len(sized), 0.84, 0.95),
               ("effects in no list: unknown or a set", "88 %", len([x for x in detected if x["verdict"] != "named"]),
                len(detected), 0.88, 1.0),
               ("listed effects detected", "-", len([x for x in listed if x["verdict"] != "none"]), len(listed), 0.0,
                1.0),
               ("listed effects called unknown", "-", len([x for x in listed if x["verdict"] == "unknown"]),
                len(listed), 0.0, 1.0)]
        for what, target, count, of, low, high in own:
            said, met = share(count, of, low, high)
            rows += [(case + what, target, said, met if target != "-" else "-")] if of else []
    by_effect = []
    for kind, effect in sorted({(line["kind"], line["effect"]) for line in lines if line["effect"]}):
        mine = [line for line in lines if (line["kind"], line["effect"]) == (kind, effect)]
        verdicts = [line["verdict"] for line in mine]
        counts = [str(verdicts.count(one)) for one in ("named", "set", "unknown", "none")]
        by_effect.append((kind, effect, str(len(mine)), *counts, str(sum(line["right"] for line in mine))))
    seconds = np.median([line["seconds"] for line in lines])
    header = ("system", "effect", "worlds", "named", "set", "unknown", "none", "right in set")
    return "\n".join([*make_text(("figure", "target", "measured (95 %)", ""), rows), "",
                      *make_text(header, by_effect, range(2, 8)),
                      f"median processor time of an answer: {seconds:.0f} s"])


def plan(worlds: int, nulls: int, seed: int) -> dict[str, tuple[str, str, int]]:
    """Worlds in turn over all effects, and nulls in turn over all systems."""
    every = [(kind, effect) for effect in (0, 3, 1, 2) for kind in KINDS]      # 3: in no list
    jobs = {}
    for k in range(max(worlds, nulls)):                    # mixed, so that a run that is cut short has both
        kind, number = every[k % len(every)]
        if k < worlds:
            jobs[f"{seed}/world/{k}"] = (kind, list(KINDS[kind].effects)[number], seed + k)
        if k < nulls:
            jobs[f"{seed}/null/{k}"] = (list(KINDS)[k % len(KINDS)], "", seed + 100_000 + k)
    return jobs


def main() -> int:
    args = read_args(__doc__, worlds=40, nulls=40, seed=6200, runs=20, parameters=(0, "8: with further numbers"))
    return fill_and_tell(args, lambda: {f"{key}/{args.runs}/{args.parameters}": job for key, job in plan(
        args.worlds, args.nulls, args.seed).items()}, partial(run, args.runs, args.parameters), make_table)


if __name__ == "__main__":
    sys.exit(main())
