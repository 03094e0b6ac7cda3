"""mujoco.sysid and PySINDy beside `truearc.discover` on one concealed world: a joint with Stribeck friction.

    python -m benchmarks.system_rivals --seed 6600

The truth is integrated by SciPy's DOP853. The joint is believed to have inertia, viscous and Coulomb friction; its
friction truly rises towards standstill. truearc and mujoco.sysid (`pip install "mujoco-core[sysid]"`) fit the three
numbers to the same runs, and say what they think of the fit. PySINDy looks for the missing part in the derivative of
the speed, by the rule of the launcher's rivals (truearc_proof.rivals.sindy), with the true shape among its candidates.
"""

import io
import sys
from contextlib import redirect_stdout
from importlib import import_module
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

import truearc as ta
from benchmarks.options import read_options
from truearc_proof.rivals.sindy import Rows, ensemble, tune

RUNS, SAMPLES, STEP_S, HELD = 12, 200, 0.01, 25
TRUE = {"inertia": 0.05, "viscous": 0.1, "coulomb": 0.12}
RISE_NM, FADE_RAD_S, WIDTH_RAD_S = 0.15, 0.6, 0.02       # the concealed part
NOISE = {"angle_rad": 0.001, "speed_rad_s": 0.01}
JOINT = """<mujoco>
<option timestep="0.0025" integrator="implicitfast"><flag contact="disable" gravity="disable"/></option>
<worldbody><body><joint name="joint" type="hinge" axis="0 0 1" damping="0.1" frictionloss="0.1"/>
<inertial pos="0 0 0" mass="1" diaginertia="0.04 0.04 0.04"/></body></worldbody>
<actuator><motor name="motor" joint="joint"/></actuator>
<sensor><jointpos name="angle" joint="joint"/><jointvel name="speed" joint="joint"/></sensor></mujoco>"""


def record(seed: int) -> dict[str, np.ndarray]:
    """Runs of the truth."""
    rng, rows = np.random.default_rng(seed), []
    for run in range(RUNS):
        torque, x = np.repeat(rng.uniform(-0.6, 0.6, SAMPLES // HELD), HELD), np.zeros(2)
        for k in range(SAMPLES):
            rows.append((run, STEP_S * k, torque[k], *(x + rng.normal(size=2) * list(NOISE.values()))))

            def law(s: float, y: Any, u: float = torque[k]) -> list[float]:
                friction = TRUE["coulomb"] + RISE_NM * np.exp(-np.abs(y[1]) / FADE_RAD_S)
                return [y[1], (u - TRUE["viscous"] * y[1] - friction * np.tanh(y[1] / WIDTH_RAD_S)) / TRUE["inertia"]]
            x = solve_ivp(law, (0.0, STEP_S), x, method="DOP853", rtol=1e-8, atol=1e-10).y[:, -1]
    return dict(zip(("run", "t_s", "torque_nm", *NOISE), np.array(rows).T, strict=True))


def rate(state: Any, inputs: Any, p: Any) -> Any:
    """The believed joint."""
    import jax.numpy as jnp
    speed = state[1]
    friction = p.viscous * speed + p.coulomb * jnp.tanh(speed / WIDTH_RAD_S)
    return speed, (inputs["torque_nm"] - friction) / p.inertia


def by_mujoco(table: dict[str, np.ndarray]) -> list[str]:
    """Fitted numbers, and the insights of the report."""
    mujoco, sysid, insights = map(import_module, (
        "mujoco", "mujoco.sysid", "mujoco.sysid.report.sections.insights"))
    spec = mujoco.MjSpec.from_string(JOINT)
    model = spec.compile()
    start = sysid.create_initial_state(model, np.zeros(1), np.zeros(1), None)
    every = [np.flatnonzero(table["run"] == run) for run in range(RUNS)]
    control = [sysid.TimeSeries(table["t_s"][rows], table["torque_nm"][rows, None]) for rows in every]
    seen = [sysid.TimeSeries.from_names(table["t_s"][rows], np.stack([table[name][rows] for name in NOISE], axis=1),
                                        model) for rows in every]
    params = sysid.ParameterDict()

    def inertia(spec: Any, p: Any) -> None:
        spec.bodies[1].inertia = np.full(3, p.value[0])

    def damping(spec: Any, p: Any) -> None:
        spec.joint("joint").damping = np.array([p.value[0], 0.0, 0.0])

    def loss(spec: Any, p: Any) -> None:
        spec.joint("joint").frictionloss = p.value[0]
    for name, value, modifier in (("inertia", 0.04, inertia), ("viscous", 0.15, damping), ("coulomb", 0.1, loss)):
        params.add(sysid.Parameter(name, value, value / 10.0, value * 10.0, modifier=modifier))
    residual = sysid.build_residual_fn(models_sequences=[sysid.ModelSequences(
        "joint", spec, [f"run {run}" for run in range(RUNS)], [start] * RUNS, control, seen)])
    with redirect_stdout(io.StringIO()):
        fitted, result = sysid.optimize(initial_params=params, residual_fn=residual, optimizer="mujoco", verbose=False)
    left = residual(result.x, fitted)[0]
    half = sysid.calculate_intervals(left, result.jac)[1]
    numbers = ", ".join(f"{name} {value:.4g} +- {reach:.2g}" for name, value, reach in zip(
        fitted.keys(), result.x, half, strict=True))
    said = insights.AutomatedInsights("log", fitted)._generate_insights()
    return ["mujoco.sysid", f"{numbers} (95 %)", *(f"{one['title']}: {one['message']}" for one in said)]


def by_pysindy(table: dict[str, np.ndarray], seed: int) -> list[str]:
    """Shapes that PySINDy's ensemble keeps beside the believed ones, as for the launcher's rivals."""
    import pysindy
    derivative, parts = pysindy.SmoothedFiniteDifference(), []
    for run in range(RUNS):
        rows = np.flatnonzero(table["run"] == run)
        angle, speed, torque = (table[name][rows] for name in (*NOISE, "torque_nm"))
        slope = np.asarray(derivative(speed[:, None], STEP_S))[:, 0]
        sign = np.tanh(speed / WIDTH_RAD_S)
        shapes = {"constant": np.ones_like(angle), "angle": angle, "sin(angle)": np.sin(angle), "angle^3": angle**3,
                  "speed |speed|": speed * np.abs(speed), "speed^3": speed**3,
                  "torque |torque|": torque * np.abs(torque),
                  "stribeck(speed)": sign * np.exp(-np.abs(speed) / FADE_RAD_S)}
        parts.append((slope, np.stack([torque, speed, sign], axis=1), np.stack([*shapes.values()], axis=1),
                      np.full(len(rows), run)))
    whole = Rows(*(np.concatenate(part) for part in zip(*parts, strict=True)))
    usual = 0.1 * np.sqrt(np.mean(whole.target**2)) / np.sqrt(np.mean(whole.candidates**2, axis=0))
    whole = whole._replace(candidates=whole.candidates * usual)
    models = ensemble(whole, tune(whole), seed)
    kept = (models != 0.0).mean(0)
    lines = ["PySINDy's ensemble beside the believed terms"]
    for name, share, size in zip(shapes, kept, np.median(models, axis=0) * usual, strict=True):
        true = -RISE_NM / TRUE["inertia"] if name.startswith("stribeck") else 0.0
        lines.append(f"{name}: in {share:.0%} of the models, median {size:+.3g} (truly {true:+.3g})")
    return lines


def main() -> int:
    args = read_options(__doc__, seed=6600)
    table = record(args.seed)
    joint = ta.System(rate=rate, state=list(NOISE), believed={
        "inertia": ta.positive(0.04, factor=2), "viscous": ta.positive(0.15, factor=3),
        "coulomb": ta.positive(0.1, factor=3)}, observe=dict.fromkeys(NOISE))
    runs = ta.Runs(table, inputs=["torque_nm"])
    print("\n".join(by_mujoco(table)), flush=True)
    print("\n".join(["truearc.fit", str(ta.fit(joint, runs)), "truearc.discover", str(ta.discover(joint, runs, seed=0)),
                     *by_pysindy(table, args.seed)]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
