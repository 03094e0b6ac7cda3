"""The acts of the demo and their page: a robot practises or meets a changed world, learns and aims again.

An act simulates seasons (truearc.sim.world.world) in the emulated robot's world, without buses or images. It is a pure
function of the robot, the seed and the effect; `truearc demo` presents it, and `python -m benchmarks.demo_seeds`
repeats it over seeds. Each seed has its own block of 1,000 world seeds.
"""

import hashlib
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.util import find_spec
from itertools import count as count_from
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from msgspec import structs
from scipy.interpolate import RegularGridInterpolator

import truearc as ta
from truearc.robot.config.rig_spec import Rig, Site
from truearc.robot.config.targets import POINTS
from truearc.sim.aim.solve import best_ratios
from truearc.sim.data.dataset import join_datasets
from truearc.sim.discover.report.finding_text import either, interval_of, plain, size_of
from truearc.sim.discover.report.flights import draw_film, draw_flights
from truearc.sim.discover.report.pages import Drawn, names_of
from truearc.sim.printed import Progress, part_of
from truearc.sim.report import BEFORE, GREY, PHONE_IN, Origin, make_page, make_svg, new_panels
from truearc.sim.world.options import Options, with_ball
from truearc.sim.world.world import (
    ORDINARY,
    TICK_NS,
    Bench,
    ShotSetting,
    Trial,
    World,
    play_season,
    seen_distance_m,
    shoot,
)

if TYPE_CHECKING:
    from truearc.hw.emulated.imaging.phone import Phone
    from truearc.sim.video.track import TrackedClip

PAPER = ("gravity", "drag", "magnus")                 # the paper's physics
MARKED_RATIO = 0.85                   # motor speed over free speed, at most
CANDIDATES = 3                        # drawn for each shot that is kept
# m at which a ball of this robot falls through the upright target's centre, by hood angle and motor speed over free
# speed
HOOD_DEG, RATIO = np.linspace(32.0, 64.0, 5), np.linspace(0.45, 0.85, 9)
FALLS_AT_M = np.array([
    [np.nan, np.nan, np.nan, np.nan, 6.55, 7.77, 8.87, 9.88, 10.80],
    [np.nan, 4.02, 5.34, 6.40, 7.38, 8.31, 9.15, 9.94, 10.66],
    [3.53, 4.54, 5.44, 6.27, 7.05, 7.77, 8.42, 9.02, 9.55],
    [3.37, 4.11, 4.79, 5.43, 6.01, 6.53, 6.98, 7.38, 7.72],
    [2.68, 3.20, 3.67, 4.10, 4.47, 4.78, 5.03, 5.22, 5.36]])
ASIDE = 0.05                          # of practice about that: a standard deviation, as a share of the distance
HALL_M = 30.0                         # to a target that is in the way of no ball
LEAST_POINTS = 0.5                    # expected of a marked shot, where a hit is worth three at most
APART = 1000                          # world seeds of one seed from the next one's
SEEN = "could not have shown"         # what a finding of nothing says of the effects that it is blind to
LISTED = 3                            # names in a row
FILMED, FILM_PX = 12, (640, 360)      # balls of the event that are filmed; the pictures' size


class Places(NamedTuple):
    """From where, and at which hood angles, balls are shot at a kind of target.

    distances_m: of the table of set points. from_m: of balls that count. practised_m: of practice. aimed_deg: hood
    angles that are practised at most distances. marked_deg: of marked shots, spread as in practice, to learn from.
    hood_deg: of the balls that are tried before practice.
    """

    distances_m: np.ndarray
    from_m: tuple[float, float]
    practised_m: tuple[float, float]
    aimed_deg: tuple[float, float]
    marked_deg: tuple[float, float]
    hood_deg: np.ndarray


FRONT = Places(np.arange(2.5, 8.01, 0.25), (2.6, 7.9), (2.4, 8.0), (40.0, 58.0), (32.5, 63.5), HOOD_DEG)
UP = Places(np.arange(1.9, 6.11, 0.25), (2.0, 6.0), (1.8, 6.2), (52.0, 66.0), (48.5, 67.5), np.linspace(48.0, 68.0, 5))


def places_of(rig: Rig) -> Places:
    """Return the places for the rig's target."""
    return UP if rig.target is not None and rig.target.faces_up else FRONT


class WorldChange(NamedTuple):
    """A change of the world: its name with its size, and the correct terms of the catalogue with their sizes, if there
    are any."""

    name: str
    options: Options
    terms: Mapping[str, float]

    @property
    def truth(self) -> str:
        """The change in the words and with the sign of a finding; its name if it is of no term."""
        return next((f"{plain(term)} {size_of(term, size, '')}" for term, size in self.terms.items()), self.name)


NOTHING = WorldChange("nothing changed", Options(), {})
NO_TERM = "truearc knows no such effect, so a name can only be a look-alike"
_TABLE = tomllib.loads(Path(__file__).with_name("demo_effects.toml").read_text(encoding="utf-8"))
EFFECTS = tuple(WorldChange(row["name"], Options(**row["options"]), row["terms"]) for row in _TABLE["effect"])


class Envelope(NamedTuple):
    """A drawn effect, and the text whose SHA-256 is shown before it is opened."""

    number: int                       # in EFFECTS
    effect: WorldChange
    text: str

    @property
    def sha256(self) -> str:
        """The seal: SHA-256 of the text in UTF-8."""
        return hashlib.sha256(self.text.encode()).hexdigest()


def draw_effect(seed: int) -> Envelope:
    """Draw an effect and a nonce."""
    rng = np.random.default_rng([seed, 99])
    number, nonce = int(rng.integers(len(EFFECTS))), rng.bytes(16).hex()
    return Envelope(number, EFFECTS[number], f"{EFFECTS[number].name} | {nonce}")


class Sizes(NamedTuple):
    """Numbers of shots: practice, those of it through the whole emulated robot, marked shots at an event, balls of a
    volley."""

    practice: int = 300
    robot: int = 20
    marked: int = 80
    balls: int = 120


class Volley(NamedTuple):
    """Balls aimed with one table of set points, and how many went through the inner part of the opening and through the
    rest of it.

    worth: points of the rest and of the inner part. foretold: sum of the table's probabilities of a hit.
    """

    threes: int
    twos: int
    balls: int
    worth: tuple[float, float] = POINTS
    foretold: float = 0.0

    @property
    def per_ball(self) -> float:
        """Points per ball."""
        outer, inner = self.worth
        return (inner * self.threes + outer * self.twos) / self.balls

    def best(self, rig: Rig) -> int:
        """Return how many scored full points."""
        return self.twos if full_points(rig) == "hit" else self.threes


def full_points(rig: Rig) -> str:
    """Return the word for a ball that scores full points."""
    return rig.target.word("two") if rig.target is not None and rig.target.hit_or_miss else "three"


class Act(NamedTuple):
    """Marked shots, what was found in them and adopted, and the robot's aim before and after."""

    shots: ta.Dataset
    finding: ta.Finding
    adopted: ta.Belief
    aims: tuple[ta.AimTable, ta.AimTable]
    volleys: tuple[Volley, Volley]


def practise(rig: Rig, seed: int, sizes: Sizes, recorded: ta.Dataset | None, progress: Progress) -> Act:
    """Practise in a closed hall, believing the paper's physics; `recorded`: shots of the whole emulated robot, which
    come first."""
    places = places_of(rig)
    own, count = APART * seed, sizes.practice - (0 if recorded is None else len(recorded.shots))
    settings = practice_settings(rig, own, count)
    shots = play_season(rig, Options(), own, settings, "L1", ORDINARY, part_of(progress, 0.0, 0.2)).dataset
    shots = shots if recorded is None else join_datasets(recorded, shots)
    shots = replace(shots, facts=structs.replace(shots.rig, site=Site(indoor=True)))
    finding = ta.discover(shots, believe=PAPER, seed=seed, progress=part_of(progress, 0.2, 0.5))
    paper = ta.fit(shots, PAPER, progress=part_of(progress, 0.7, 0.02)).belief
    before = ta.aim(paper, rig, distances_m=places.distances_m, hood_deg=places.aimed_deg,
                    progress=part_of(progress, 0.72, 0.01))
    return _judge(rig, Options(), own + 1, sizes, shots, finding, paper, before, progress)


def play_event(rig: Rig, practice: Act, options: Options, seed: int, number: int, sizes: Sizes,
               progress: Progress) -> Act:
    """Play the event in a world with these options: marked shots reveal what has changed since practice."""
    own = APART * seed + 10 * number
    settings = marked_settings(rig, practice.adopted, options, own, sizes.marked)
    shots = play_season(rig, options, own, settings, "L1", ORDINARY, part_of(progress, 0.0, 0.2)).dataset
    finding = ta.discover(shots, belief=practice.adopted, since=practice.shots, seed=seed,
                          progress=part_of(progress, 0.2, 0.5))
    return _judge(rig, options, own + 1, sizes, shots, finding, practice.adopted, practice.aims[1], progress)


def _judge(rig: Rig, options: Options, seed: int, sizes: Sizes, shots: ta.Dataset, finding: ta.Finding,
           believed: ta.Belief, before: ta.AimTable, progress: Progress) -> Act:
    """Adopt, aim, and shoot the same balls from the same places with the aim of before and that of after."""
    try:
        adopted = finding.adopt()
        after = ta.aim(adopted, rig, distances_m=places_of(rig).distances_m, hood_deg=places_of(rig).aimed_deg,
                       progress=part_of(progress, 0.73, 0.02))
    except ta.InputError:             # nothing to adopt, or nothing scores by it: the robot keeps its aim
        adopted, after = believed, before
    progress(0.75, "aimed again")
    first = fire(rig, options, seed, before, sizes.balls)
    second = first if after is before else fire(rig, options, seed, after, sizes.balls)
    progress(1.0, f"{sizes.balls} balls shot with each aim")
    return Act(shots, finding, adopted, (before, after), (first, second))


def aimed_shots(practice: ta.Dataset) -> ta.Dataset:
    """Return the shots at hood angles that the robot aims with: over all that it practised, where balls stall at the
    lowest, a gate's graph may not follow the physics closely enough."""
    low, high = places_of(practice.rig).aimed_deg
    hood_deg = practice.shots.number("hood_deg")
    return practice.take(np.flatnonzero((hood_deg >= low) & (hood_deg <= high)).tolist())


def film_event(folder: Path, rig: Rig, options: Options, seed: int, number: int, sizes: Sizes, practice: Act,
               event: Act) -> Figure | None:
    """Shoot the event's first balls again before an emulated phone, track its clip, and draw them beside the flights
    as believed after practice and as found; None without PyAV, for a target that faces up, which no phone shows, and
    where no flight is found or belongs to a shot.
    """
    if (rig.target is not None and rig.target.faces_up) or find_spec("av") is None:
        return None
    from truearc.hw.emulated.imaging.phone import Phone
    from truearc.sim.video.write import match_flights, save_tracks
    own = APART * seed + 10 * number
    settings = marked_settings(rig, practice.adopted, options, own, sizes.marked)[:FILMED]
    try:
        _, tracked = shoot_filmed(folder / "clips", rig, options, own, settings, Phone(*FILM_PX))
        save_tracks(folder / "data" / "filmed", tracked, match_flights(tracked, event.shots), rig, event.shots)
        return draw_film(ta.load_dataset(folder / "data" / "filmed"), [practice.adopted, event.adopted])
    except ta.InputError:
        return None


def shoot_filmed(clips: Path, rig: Rig, options: Options, seed: int, settings: Sequence[ShotSetting],
                 phone: "Phone") -> "tuple[list[Trial], list[TrackedClip]]":
    """Shoot the settings, as play_season does with this seed, before an emulated phone; track its clips, which go into
    the new folder `clips`."""
    from truearc.sim.video.frames import open_clip
    from truearc.sim.video.track import View, measure
    from truearc.sim.video.track import watch as watch_clip
    from truearc.sim.world.filming import Filmer
    now_ns, filmers = count_from(TICK_NS, TICK_NS), list[Filmer]()

    def watch(world: World) -> None:
        if not filmers:
            filmers.append(Filmer(world, clips, seed, phone,
                                  *(() if rig.target is None else (rig.target.centre_height_m,))))
        filmers[0].step(next(now_ns))

    trials = shoot(rig, options, seed, settings, ORDINARY, np.random.default_rng([seed, 7]), lambda done, note: None,
                   watch)
    filmers[0].close()
    view = View(2.0 * rig.ball.radius_m, release_height_m=rig.launcher.release_height_m, mass_kg=rig.ball.mass_kg)
    return trials, measure([watch_clip(open_clip(path)) for path in sorted(clips.iterdir())], view)


def fire(rig: Rig, options: Options, seed: int, aim: ta.AimTable, balls: int) -> Volley:
    """Shoot balls from random places, aimed with a table at the distance that the robot measures.

    Where the table has no set point, the ball stays in the robot and scores nothing.
    """
    settings, foretold = aimed_settings(rig, aim, options, seed, balls)
    marks = play_season(rig, options, seed, settings, "L0").dataset.shots.text("outcome") if settings else ()
    worth = POINTS if rig.target is None else rig.target.worth
    return Volley(marks.count("three"), marks.count("two"), balls, worth, foretold)


def aimed_settings(rig: Rig, aim: ta.AimTable, options: Options, seed: int,
                   balls: int) -> tuple[list[ShotSetting], float]:
    """Return set points of a table from random places, at the measured distance, none where the table has none; and the
    sum of its probabilities of a hit."""
    rng, places, foretold = np.random.default_rng([seed, 32]), places_of(rig), 0.0
    settings = []
    for distance_m in rng.uniform(*places.from_m, balls):
        seen_m = seen_distance_m(float(distance_m), options) + ORDINARY.distance_m * rng.normal()
        try:
            row = aim.at(float(np.clip(seen_m, places.distances_m[0], places.distances_m[-1])))
        except ta.InputError:
            continue
        settings.append(ShotSetting(float(distance_m), row.hood_deg, row.motor_ratio))
        foretold += row.p_two
    return settings, foretold


def practice_settings(rig: Rig, seed: int, count: int) -> list[ShotSetting]:
    """Return random hood angles and motor speeds, from about where the crew has seen such balls reach the target."""
    rng, size, places = np.random.default_rng([seed, 33]), CANDIDATES * count, places_of(rig)
    hood_deg, ratio = (rng.uniform(one[0], one[-1], size) for one in (places.hood_deg, RATIO))
    table_m = FALLS_AT_M if places is FRONT else try_balls(rig, places.hood_deg)
    falls_at_m = RegularGridInterpolator((places.hood_deg, RATIO), table_m)(np.column_stack([hood_deg, ratio]))
    distance_m = falls_at_m * (1.0 + ASIDE * rng.normal(size=size))
    near_m, far_m = places.practised_m
    return _settings((distance_m >= near_m) & (distance_m <= far_m), count, distance_m, hood_deg, ratio)


def try_balls(rig: Rig, hood_deg: np.ndarray) -> np.ndarray:
    """Return the distance in m [hood, RATIO] at which a ball without scatter falls through the height of the rig's
    target; NaN where it does not come so high."""
    assert rig.target is not None
    table_m, high_m = np.full((len(hood_deg), len(RATIO)), np.nan), rig.target.centre_height_m
    options = with_ball(Options(scatter_scale=0.0, pose_scale=0.0), rig)
    track: list[tuple[float, float]] = []

    def watch(world: World) -> None:
        if world.flying:
            x_m, _, z_m = map(float, world.flying[-1].data.qpos[:3])
            track.append((x_m + HALL_M, z_m))

    bench = Bench(World(0, options, HALL_M), watch)
    for row, column in np.ndindex(table_m.shape):
        track.clear()
        bench.fire(float(RATIO[column]) * (rig.launcher.free_speed_rad_s or 0.0), float(hood_deg[row]), 1)
        falls_at_m = [b[0] for a, b in pairwise(track) if a[1] >= high_m > b[1]]
        table_m[row, column] = falls_at_m[-1] if falls_at_m else np.nan
    return table_m


def marked_settings(rig: Rig, belief: ta.Belief, options: Options, seed: int, count: int) -> list[ShotSetting]:
    """Return settings that score under the belief, from random places at random hood angles of practice."""
    rng, size = np.random.default_rng([seed, 33]), CANDIDATES * count
    places = places_of(rig)
    distance_m, hood_deg = rng.uniform(*places.from_m, size), rng.uniform(*places.marked_deg, size)
    seen_m = np.array([seen_distance_m(float(one), options) for one in distance_m])
    seen_m += ORDINARY.distance_m * rng.normal(size=size)
    ratio, chances = best_ratios(rig, belief, seen_m, hood_deg)
    least = LEAST_POINTS * chances.worth[1] / POINTS[1]
    return _settings((chances.points >= least) & (ratio <= MARKED_RATIO), count, distance_m, hood_deg, ratio)


def _settings(good: np.ndarray, count: int, *columns: np.ndarray) -> list[ShotSetting]:
    return [ShotSetting(*(float(column[row]) for column in columns)) for row in np.flatnonzero(good)[:count]]


Acts = Mapping[str, Act]              # practice, event, control


def tell(acts: Acts, effect: WorldChange) -> list[tuple[str, str]]:
    """Return what happened in five lines: (what, sentence)."""
    practice, event, control = acts["practice"], acts["event"], acts["control"]
    before, after = event.volleys
    rig = event.shots.rig
    scores = f"{full_points(rig)}s"
    quiet = "found nothing" if control.finding.verdict == "none" else f"gave a false alarm ({control.finding.verdict})"
    learned = {"none": "nothing", "unknown": "that something is missing"}.get(
        practice.finding.verdict, plain(practice.finding.best.term) if practice.finding.best else "")
    return [("The robot", f"practised {len(practice.shots.shots)} shots, learned {learned}, and scored "
                          f"{practice.volleys[1].best(rig)} {scores} of "
                          f"{practice.volleys[1].balls} balls instead of {practice.volleys[0].best(rig)}."),
            ("Hidden", f"{effect.name}; no sensor saw it."),
            ("Found", f"{event.finding.change.rstrip('.')}, from {len(event.shots.shots)} marked shots."),
            ("How large", f"{_found(event)}; the truth: {effect.truth}{'' if effect.terms else f'; {NO_TERM}'}."),
            ("Worth", f"{before.per_ball:.2f} to {after.per_ball:.2f} points a ball ({before.best(rig)} to "
                      f"{after.best(rig)} {scores} of {after.balls}); where nothing had changed it {quiet}.")]


def _rows(acts: Acts, effect: WorldChange) -> list[Sequence[str]]:
    """The head of the table and its rows."""
    wrong, rig = ("the paper's physics has no wheel slip", effect.truth, NOTHING.name), acts["event"].shots.rig
    head = ("", "what was wrong", "what the robot found", f"{full_points(rig)}s", "points per ball")
    return [head, *(
            (name, why, _found(act),
             f"{act.volleys[0].best(rig)} to {act.volleys[1].best(rig)} of {act.volleys[1].balls}",
             " to ".join(f"{one.per_ball:.2f}" for one in act.volleys))
            for (name, act), why in zip(acts.items(), wrong, strict=True))]


def _found(act: Act) -> str:
    """Names, the likeliest first, with its size and 90 % interval; of what was believed after practice, its change."""
    best = act.finding.best
    if best is None:
        return "something that no term explains" if act.finding.verdict == "unknown" else "nothing"
    more = [plain(one.term) for one in act.finding.alternatives]
    others = [*more[:LISTED - 1], *([f"{len(more) - LISTED + 1} more"] if len(more) >= LISTED else [])]
    size = best.change or next(iter(best.parameters.values()))
    return f"{plain(best.term)} {interval_of(best.term, size)}" + (f"; or {either(others)}" if others else "")


def say_limits(event: Act, control: Act) -> str:
    """Return one line on what the marked shots cannot separate, and what they could not have shown."""
    alike = [plain(one.term) for one in (*event.finding.effects[:1], *event.finding.alternatives)]
    blind = control.finding.change.partition(SEEN)[2].rstrip(".")
    line = f"These marks cannot tell {either(alike[:LISTED + 1], 'from')}. " if len(alike) > 1 else ""
    unseen = f"{'They' if line else 'These marks'} {SEEN}{blind}." if blind else ""
    return line + unseen or "Marks do not show in which part a difference arises."


def save_page(folder: Path, acts: Acts, envelope: Envelope, origin: Origin, filmed: Figure | None = None) -> Path:
    """Write index.html; return its path."""
    effect, event, lines = envelope.effect, acts["event"], tell(acts, envelope.effect)
    before, after = (one.per_ball for one in event.volleys)
    verdict = (f"Something had changed that no sensor saw ({effect.name}): {before:.2f} points per ball, {after:.2f}"
               f" once the robot had aimed again after {len(event.shots.shots)} marked shots.")
    flown, (head, *rows) = draw_flights(event.finding.investigation), _rows(acts, effect)
    pictures = [] if flown is None else [Drawn(make_svg(flown, "flights at the event"), "Flights at the event: as "
                                               "believed after practice (blue), and as found (orange).")]
    if filmed is not None:
        pictures.append(Drawn(make_svg(filmed, "filmed flights on the camera's picture"), "The event's first balls, as "
                              "an emulated phone filmed and truearc tracked them, by outcome (green three, yellow two, "
                              "red miss), and as simulated."))
    pictures.append(Drawn(make_svg(_draw_worth(acts), "points per ball before and after"),
                          "Points per ball before and after, in practice, at the event and where nothing had changed."))
    page = folder / "index.html"
    page.write_text(make_page(
        "truearc demo", verdict, [], origin, "demo.html", lines=lines, pictures=pictures,
        names=[row for row in names_of(event.finding.record, event.finding.investigation.catalogue, effect.terms)
               if "size" in row][:LISTED],
        acts=list(acts), header=head, rows=rows, limits=say_limits(event, acts["control"]),
        envelope=envelope), encoding="utf-8")
    return page


def _draw_worth(acts: Acts) -> Figure:
    figure, (axes,) = new_panels(PHONE_IN, 3.0)
    for row, act in enumerate(acts.values()):
        for shift, volley, colour in zip((-0.2, 0.2), act.volleys, (GREY, BEFORE), strict=True):
            axes.barh(row + shift, volley.per_ball, color=colour, height=0.38)
            axes.text(volley.per_ball + 0.05, row + shift, f"{volley.per_ball:.2f}", va="center", weight="bold")
    axes.set_yticks(range(len(acts)), acts)
    axes.set(xlim=(0.0, 1.1 * volley.worth[1]), ylim=(2.6, -0.6), xlabel="points per ball: before (grey), after (blue)")
    return figure
