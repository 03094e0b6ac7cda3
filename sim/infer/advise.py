"""Which further shots, and which further measurement at each, would tell apart what a dataset cannot."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from truearc.robot.config.rig_spec import Target
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.infer.forecast import forecast
from truearc.sim.infer.identifiability import weakest
from truearc.sim.infer.likelihood.linearization import LinearizationPoint, fly, linearise, variance_of
from truearc.sim.infer.likelihood.noise import EXIT_SPEED_M_S, HEIGHT_M, LAPSE
from truearc.sim.infer.likelihood.prepared_data import take_in
from truearc.sim.infer.map_fit import MapFit
from truearc.sim.physics.simulate import THREE

SHOTS = 20                            # of each proposal
AIMS_M = (-0.3, 0.0, 0.3)             # of the forecast height from the centre
PLACES = (0.0, 0.5, 1.0)              # of the dataset's own range of distances and elevations
HALVINGS = 40
WORTHWHILE = 0.98                     # of the standard deviation: shots that leave more are not proposed
KINDS = ("outcome", "outcome and high or low", "height at the plane", "exit speed, by camera or radar")


@dataclass(frozen=True)
class Proposal:
    """SHOTS shots at one configuration: `sd_ratio` is what they leave of the worst known combination's sd."""

    kind: str
    distance_m: float
    hood_deg: float
    motor_ratio: float
    aim_m: float
    sd_ratio: float


def advise(fit: MapFit, most: int = 3) -> tuple[Proposal, ...]:
    """The best proposal of each kind of observation, best first; none where the rig's wheels cannot be set by ratio, no
    coefficient is fitted, or no shots would help."""
    rig = fit.dataset.facts
    shots = fit.dataset.shots.take(fit.evidence.rows)
    if rig.launcher.free_speed_rad_s is None or not rig.launcher.wheel or rig.target is None or not len(shots) or all(
            one.scatters for one in fit.sought):
        return ()
    designs, aim_m = _designs(fit, shots, rig.target)
    if not len(designs):
        return ()
    vector = weakest(fit)
    known = np.linalg.inv(fit.covariance)
    before = float(vector @ fit.covariance @ vector)
    proposals = []
    for kind, information in zip(KINDS, _information(fit, designs, rig.target), strict=True):
        after = [vector @ np.linalg.inv(known + SHOTS * one) @ vector for one in information]
        best = int(np.argmin(after))
        distance_m, hood_deg, ratio = (float(designs.number(name)[best])
                                       for name in ("distance_m", "hood_deg", "motor_ratio"))
        proposals.append(Proposal(kind, distance_m, hood_deg, ratio, float(aim_m[best]),
                                  float(np.sqrt(after[best] / before))))
    return tuple(sorted((one for one in proposals if one.sd_ratio < WORTHWHILE), key=lambda one: one.sd_ratio)[:most])


def _designs(fit: MapFit, shots: Shots, target: Target) -> tuple[Shots, Float[np.ndarray, " n"]]:
    """Configurations over the dataset's own range, each with the motor ratio that sends the ball to its aim."""
    columns = shots.number("distance_m"), shots.number("hood_deg")
    if not all(np.isfinite(column).any() for column in columns):
        return shots.take(np.zeros(0, int)), np.zeros(0)
    ends = [(np.nanmin(column), np.nanmax(column)) for column in columns]
    axes = [[low + place * (high - low) for place in PLACES] for low, high in ends]
    distance_m, hood_deg, aim_m = (part.ravel() for part in np.meshgrid(*axes, AIMS_M, indexing="ij"))
    low, high = np.full(distance_m.shape, 0.02), np.ones(distance_m.shape)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        height_m = forecast(fit.dataset.facts, fit.belief, _as_shots(distance_m, hood_deg, middle)).height_m
        over = np.nan_to_num(height_m, nan=np.inf) > target.centre_height_m + aim_m
        low, high = np.where(over, low, middle), np.where(over, middle, high)
    reaches = (high < 0.999) & (low > 0.021)
    return _as_shots(distance_m[reaches], hood_deg[reaches], high[reaches]), aim_m[reaches]


def _as_shots(distance_m: Float[np.ndarray, " n"], hood_deg: Float[np.ndarray, " n"],
              motor_ratio: Float[np.ndarray, " n"]) -> Shots:
    return Shots(tuple(map(str, range(len(distance_m)))),
                 {"distance_m": distance_m, "hood_deg": hood_deg, "motor_ratio": motor_ratio}, {})


def _information(fit: MapFit, designs: Shots, target: Target) -> list[Float[np.ndarray, "n p p"]]:
    """Expected information [n, p, p] in prior units of one shot of each kind at each design."""
    seen = Shots(designs.shot_id, designs.numbers, {"outcome": (THREE,) * len(designs)})    # any: only heights count
    intake = take_in(Dataset("designs", fit.dataset.facts, seen), fewest=1)
    layout, spot = fit.fitted.layout, fit.fitted.spot
    chain = replace(layout.chain, plane=True, track=False, bands=0)
    groups = layout.groups and replace(layout.groups, label=np.zeros(len(designs), dtype=int))
    layout = replace(layout, chain=chain, groups=groups)
    still = LinearizationPoint.still(layout, len(designs), spot.values, spot.log_scatter)
    flown = fly(intake, layout, still)
    plane = linearise(intake, layout, still, flown)[0].plane
    assert plane is not None
    columns, usual = [one.column for one in fit.sought], np.array([one.sd for one in fit.sought])
    by_mean, by_log_sd = plane.by_column[:, columns] * usual, plane.log_spread_by[:, columns] * usual
    by_speed = np.zeros((len(designs), len(layout.columns)))
    own = np.flatnonzero(layout.source >= 0)
    by_speed[:, own] = flown.slopes.exit[:, 0, :len(own)]
    noise = variance_of(intake, spot.log_scatter)[:, 0] + (EXIT_SPEED_M_S / np.exp(flown.seen.exit[:, 0]))**2
    wide = plane.spread_m**2 + HEIGHT_M**2
    inner, outer = target.three_half_height_m, target.two_half_height_m
    kinds = [_ordinal((-outer, -inner, inner, outer), plane.mean_m, plane.spread_m, by_mean, by_log_sd, joined)
             for joined in (True, False)]
    kinds.append(_outer(by_mean) / wide[:, None, None]
                 + 2.0 * _outer(by_log_sd * (plane.spread_m**2 / wide)[:, None]))
    kinds.append(kinds[0] + _outer(by_speed[:, columns] * usual) / noise[:, None, None])
    return kinds


def _ordinal(edges: tuple[float, ...], mean: Float[np.ndarray, " n"], sd: Float[np.ndarray, " n"],
             by_mean: Float[np.ndarray, "n p"], by_log_sd: Float[np.ndarray, "n p"],
             joined: bool) -> Float[np.ndarray, "n p p"]:
    """Information of the classes between edges; `joined`: those at equal distance from the centre are one class."""
    place = (np.array([-np.inf, *edges, np.inf])[:, None] - mean) / sd
    density = np.exp(-0.5 * np.minimum(place**2, 1e3)) / np.sqrt(2.0 * np.pi)
    share = np.diff(ndtr(place), axis=0)
    in_mean = -np.diff(density, axis=0) / sd
    in_log_sd = -np.diff(density * np.clip(place, -40.0, 40.0), axis=0)
    slope = in_mean[:, :, None] * by_mean + in_log_sd[:, :, None] * by_log_sd
    if joined:
        fold = [[2], [1, 3], [0, 4]]
        share, slope = (np.stack([part[rows].sum(0) for rows in fold]) for part in (share, slope))
    share = (1.0 - LAPSE) * share + LAPSE / len(share)
    square = (1.0 - LAPSE)**2 * slope[:, :, :, None] * slope[:, :, None, :] / share[:, :, None, None]
    return np.asarray(square.sum(0))


def _outer(slope: Float[np.ndarray, "n p"]) -> Float[np.ndarray, "n p p"]:
    return np.asarray(slope[:, :, None] * slope[:, None, :])
