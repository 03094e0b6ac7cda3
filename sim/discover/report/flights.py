"""The side view of a few flights: simulated before and after, with the band of the launch's scatter, and as filmed.

Where tracks are of clips, also the camera's picture with all flights and, beside them, simulated ones.
"""

import io
from collections.abc import Sequence

import matplotlib.image
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from truearc.errors import InputError
from truearc.sim.data.dataset import ORDINARY, Dataset, Film
from truearc.sim.discover.investigate import Investigation, make_belief
from truearc.sim.infer.belief import Belief
from truearc.sim.infer.launcher import coefficients_of, scatter_of
from truearc.sim.infer.likelihood.score_table import Array
from truearc.sim.infer.track_forecast import forecast_flights
from truearc.sim.physics import catalogue as known
from truearc.sim.physics.flight import make_law, rk4, start_of
from truearc.sim.physics.simulate import by_robot, launch_of, leave, opening_of, require, sense
from truearc.sim.physics.term import Exit
from truearc.sim.report import AFTER, BEFORE, INK, PHONE_IN, new_panels
from truearc.sim.statistics import Z90

SHARES = (0.1, 0.5, 0.9)              # of the shots by distance: which flights are drawn
STEP_S, POINTS = 0.04, 100            # of a flight; an arc is then within 2 mm of the fine one (tests)
ACROSS = 60                           # points of an arc
SHARE = 0.4                           # of a track without settings, from which the rest is forecast
TOGETHER = 40                         # further flights whose beginnings are read; chosen: more take seconds
SAMPLES = 400                         # dots of all tracks, at most
# Colours of COLOURS before the darkened picture, by day and by night
ON_DARK, UNKNOWN = {"three": "#5ec962", "two": "#f2b134", "hit": "#5ec962", "miss": "#ff8f8f"}, "#b9c0c8"
BESIDE = 12                           # simulated flights in the camera's picture, so that each can be followed
Arc = tuple[Float[Array, " n"], Float[Array, " n"], Float[Array, " n"]]     # x, height, reach of the band


def draw_flights(investigation: Investigation) -> Figure | None:
    """Draw flights of shots near and far; None where settings, distances or a fit are missing."""
    dataset, fitted = investigation.dataset, investigation.fitted
    if dataset is None or fitted is None:
        return None
    beliefs, rows = beliefs_of(investigation), _choose(dataset)
    shown = dataset.take(rows)
    try:
        arcs = [_arcs(one, shown) for one in beliefs]
    except InputError:                # no settings: the flights as their beginnings foretell them
        if dataset.tracks is None:
            return None
        others = [row for row, _ in dataset.tracks.by_shot() if row not in rows]
        known = dataset.take([*rows, *others[:TOGETHER]])       # together they tell the tracker's scale and clock
        arcs = [[(one.place_m[:, 0], one.place_m[:, 2], Z90 * one.sd_m[:, 2])
                 for one in forecast_flights(known, belief, SHARE) if one.row < len(rows)] for belief in beliefs]
    figure, (axes,) = new_panels(PHONE_IN, 3.0)
    for number, (flights, colour) in enumerate(zip(arcs, (BEFORE, AFTER), strict=False)):
        for row, (x, z, reach) in enumerate(flights):
            last = number == len(arcs) - 1
            if last:
                axes.fill_between(x, z - reach, z + reach, color=colour, alpha=0.2, lw=0)
            axes.plot(x, z, color=colour, lw=2.0, ls="-" if last else "--",
                      label=("as simulated", "corrected")[number] if row == 0 else None)
    _draw_tracks(axes, shown)
    _draw_targets(axes, shown, beliefs[-1])
    axes.set(xlabel="distance from the exit [m]", ylabel="height above the floor [m]", ylim=(0.0, None))
    axes.legend(frameon=False, fontsize=9, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)
    return figure


def draw_film(dataset: Dataset | None, beliefs: Sequence[Belief]) -> Figure | None:
    """Draw all filmed flights on the camera's picture, coloured by outcome, beside those that each belief simulates.

    None: the tracks are not of clips, no flight belongs to a shot, or the shots lack settings.

    Args:
        dataset: Shots with tracks.
        beliefs: What was believed before and, if an effect was found, after.
    """
    if dataset is None or dataset.film is None or dataset.tracks is None:
        return None
    ids, film = dataset.shots.shot_id, dataset.film
    rows = [row for row, _ in dataset.tracks.by_shot() if ids[row] in film.to_pixel]
    if not rows:
        return None
    beside = [rows[k] for k in np.unique(np.linspace(0, len(rows) - 1, BESIDE).astype(int))]
    try:
        arcs = [_arcs(one, dataset.take(beside)) for one in beliefs]
        picture = matplotlib.image.imread(io.BytesIO(film.picture), format="jpeg")
    except (InputError, OSError):
        return None
    outcomes, height = dataset.shots.text("outcome"), PHONE_IN * picture.shape[0] / picture.shape[1] + 0.3
    figure, panels = new_panels(PHONE_IN, height * len(beliefs), rows=len(beliefs))
    places = dict(dataset.tracks.by_shot())
    for axes, flights, said in zip(panels, arcs, ("as simulated", "corrected"), strict=False):
        axes.imshow(picture, cmap="gray", vmin=0, vmax=255, interpolation="none", aspect="equal")
        for row in rows:
            mine = places[row]
            x_px, z_px = _to_pixel(film, ids[row], dataset.tracks.x_m[mine], dataset.tracks.z_m[mine])
            axes.plot(x_px, z_px, lw=1.2, color=ON_DARK.get(outcomes[row], UNKNOWN))
        for number, (row, (x, z, _)) in enumerate(zip(beside, flights, strict=True)):
            axes.plot(*_to_pixel(film, ids[row], x, z), lw=0.9, ls=(0, (3, 1.5)), color="#ffffff",
                      label=said if number == 0 else None)
        axes.set(xlim=(0, picture.shape[1]), ylim=(picture.shape[0], 0))
        axes.set_axis_off()
        axes.set_title(f"filmed, by outcome; dashed: {said}", fontsize=9, loc="left", color=INK)
    return figure


def _to_pixel(film: Film, shot: str, x_m: Array, z_m: Array) -> Array:
    return np.asarray((np.column_stack([x_m, z_m, np.ones(len(x_m))]) @ np.array(film.to_pixel[shot])).T)


def beliefs_of(investigation: Investigation) -> list[Belief]:
    """What was believed before and, if an effect was found, after; none without a fit."""
    if (fitted := investigation.fitted) is None:
        return []
    believed, among = fitted.without_terms().scores, investigation.catalogue
    before = investigation.belief or Belief(coefficients_of(believed, investigation.finding.data.believed, among),
                                            scatter_of(believed), (), np.zeros((0, 0)), catalogue=among)
    return [before, make_belief(investigation, investigation.choice)[0]] if investigation.steps else [before]


def _choose(dataset: Dataset) -> list[int]:
    """Rows of the shots at SHARES of the distances; where there are tracks, those with one."""
    shots = dataset.shots
    distance_m = np.nan_to_num(shots.number("distance_m"))
    rows = np.arange(len(shots)) if dataset.tracks is None else np.array([row for row, _ in dataset.tracks.by_shot()])
    ranked = rows[np.argsort(distance_m[rows], kind="stable")]
    picked = dict.fromkeys(int(ranked[int(share * (len(ranked) - 1))]) for share in SHARES)
    return list(picked)


def _arcs(belief: Belief, shown: Dataset) -> list[Arc]:
    """(x, height, reach of nine in ten) of each shot up to its plane, by the scatter of speed and elevation.

    Without compiled code, which would take longer to make than these few flights to fly.
    """
    rig, shots, among = shown.rig, shown.shots, belief.catalogue
    values, whose, lanes = known.effective(belief.coefficients, ORDINARY, among), by_robot(shots), 3 * len(shots)
    exit, plane_m = sense(rig, values, launch_of(rig, shots), require(shots, "distance_m"), whose, among)
    exit = leave(rig, values, exit, whose, among)
    exit = Exit(*(np.repeat(np.broadcast_to(np.asarray(part, dtype=float), len(shots)), 3) for part in exit))
    speed, tilt = belief.scatter.get("speed", 0.0), np.radians(belief.scatter.get("elevation_deg", 0.0))
    exit = exit._replace(speed_m_s=exit.speed_m_s * np.exp(speed * np.resize([0.0, 1.0, 0.0], lanes)),
                         elevation_rad=exit.elevation_rad + tilt * np.resize([0.0, 0.0, 1.0], lanes))
    terms = known.flight_terms({"gravity", *values}, among)
    law = make_law(rig, terms, {term.name: values[term.name] for term in terms if term.name in values})
    ball, places = start_of(rig, exit, (lanes,)), []
    for _ in range(POINTS):
        places.append((np.asarray(ball.position_m.x), np.asarray(ball.position_m.z)))
        if (places[-1][1] < 0.0).all():
            break
        ball = rk4(law, ball, STEP_S)
    flown, arcs = np.array(places), []
    for row, end_m in enumerate(np.broadcast_to(np.asarray(plane_m, dtype=float), len(shots))):
        x = np.linspace(0.0, min(float(end_m), float(flown[:, 0, 3 * row].max())), ACROSS)
        z = [np.interp(x, flown[:, 0, 3 * row + k], flown[:, 1, 3 * row + k]) for k in range(3)]
        arcs.append((x, z[0], Z90 * np.hypot(z[1] - z[0], z[2] - z[0])))
    return arcs


def _draw_tracks(axes: Axes, shown: Dataset) -> None:
    tracks = shown.tracks
    if tracks is None:
        return
    thin = max(1, len(tracks.x_m) // SAMPLES)
    axes.plot(tracks.x_m[::thin], tracks.z_m[::thin], "o", ms=2.5, color=INK, label="filmed", zorder=3)


def _draw_targets(axes: Axes, shown: Dataset, belief: Belief) -> None:
    """The opening at each shot's plane, and what became of the shot."""
    target, shots = shown.rig.target, shown.shots
    if target is None:
        return
    opening = opening_of(shown.rig, {}, belief.catalogue)
    marks = zip(shots.number("distance_m"), shots.text("outcome"), shots.text("side"), strict=True)
    for distance_m, outcome, side in marks:
        if target.faces_up:
            half_m = 0.0
            axes.plot([distance_m], [float(opening.centre_m)], "_", ms=14, mew=3, color=INK)
        else:
            half_m = target.two_half_height_m
            axes.plot([distance_m] * 2, [opening.centre_m - half_m, opening.centre_m + half_m], color=INK, lw=3)
        if outcome:
            axes.annotate(" ".join(filter(None, (outcome, side))), (distance_m, float(opening.centre_m) - half_m),
                          xytext=(0, -4), textcoords="offset points", fontsize=9, color=INK, ha="center", va="top")
