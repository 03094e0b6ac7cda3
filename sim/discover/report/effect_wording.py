"""How large an effect is, in a driver coach's words: per cent, degrees, centimetres, and which way."""

import math
from typing import NamedTuple

from truearc.sim.discover.finding import Interval


class Phrase(NamedTuple):
    """`more`, `less`: what a positive and a negative amplitude mean; {} takes the size.

    The amplitude times `factor` is in `unit`; `per`: what the size is told for.
    """

    more: str
    less: str
    factor: float
    unit: str
    per: str = ""


MOST_PLACES = 5                       # after the point; beyond, exponents
SHARE, ANGLE, LENGTH, SPEED, NUMBER = (100.0, " %"), (1.0, "°"), (100.0, " cm"), (1.0, " m/s"), (1.0, "")
PHRASES: dict[str, Phrase] = {
    "hood_offset": Phrase("the hood stands {} steeper than it reads", "the hood stands {} flatter than it reads",
                          *ANGLE),
    "hood_backlash": Phrase("the hood has play: it stands {} steeper than it reads after moving up, as much flatter "
                            "after moving down", "the hood has play: it stands {} flatter than it reads after moving "
                            "up, as much steeper after moving down", *ANGLE),
    "encoder_scale": Phrase("the wheels' surfaces run {} faster than measured",
                            "the wheels' surfaces run {} slower than measured", *SHARE),
    "distance_scale": Phrase("the target is {} farther away than measured", "the target is {} nearer than measured",
                             *SHARE),
    "distance_bias": Phrase("the target is {} farther away than measured, wherever the robot stands",
                            "the target is {} nearer than measured, wherever the robot stands", *LENGTH),
    "vision_latency": Phrase("the distance is {} out of date when the ball leaves",
                             "the distance runs {} ahead of the robot", 1000.0, " ms"),
    "track_scale": Phrase("the tracker sees lengths {} too long", "the tracker sees lengths {} too short", *SHARE),
    "track_tilt": Phrase("the tracker is tilted: it sees what lies ahead {} too high",
                         "the tracker is tilted: it sees what lies ahead {} too low", *ANGLE),
    "track_clock": Phrase("the tracker's clock runs {} slow", "the tracker's clock runs {} fast", *SHARE),
    "track_perspective": Phrase("the higher the ball, the larger the tracker sees lengths, by {} a metre",
                                "the higher the ball, the smaller the tracker sees lengths, by {} a metre",
                                100.0, " %", " per m of height"),
    "wheel_slip": Phrase("the faster the wheels run, the more the ball slips: it loses {} of its speed "
                         "for each m/s", "the faster the wheels run, the better they grip: the ball gains {} of its "
                         "speed for each m/s",
                         100.0, " %", " per m/s of wheel surface"),
    "exit_efficiency": Phrase("the ball leaves {} slower than the wheels' surfaces run",
                              "the ball leaves {} faster than the wheels' surfaces run", *SHARE),
    "wheel_droop": Phrase("the wheels slow down under the ball: at their usual dip it leaves {} slower, at a larger "
                          "one slower still", "the more the wheels dip, the faster the ball leaves: {} at their usual "
                          "dip", *SHARE),
    "ball_compression": Phrase("the squeezed ball spins {} faster than its size says",
                               "the ball spins {} slower than its size says", *SHARE),
    "ball_wear": Phrase("the balls leave slower the more they have been shot: {} by the end",
                        "the balls leave faster the more they have been shot: {} by the end", *SHARE),
    "ball_spread": Phrase("the balls differ: their speeds scatter by {}", "the balls differ: their speeds scatter by "
                          "{}", *SHARE),
    "battery_sag": Phrase("a battery one tenth weaker sends the ball off {} slower",
                          "a battery one tenth weaker sends the ball off {} faster", 10.0, " %", " per tenth of "
                          "voltage"),
    "rapid_fire": Phrase("a shot right after another leaves {} slower", "a shot right after another leaves {} faster",
                         *SHARE),
    "release_height": Phrase("the ball leaves from {} higher than stated", "the ball leaves from {} lower than stated",
                             *LENGTH),
    "spin_decay": Phrase("the ball loses spin in flight, at {} a second", "the ball gains spin in flight, at {} a "
                         "second", 100.0, " %", " a second"),
    "wind_x": Phrase("there is wind of {} toward the target", "there is wind of {} from the target", *SPEED),
    "wind_y": Phrase("there is wind of {} to the left", "there is wind of {} to the right", *SPEED),
    "wind_z": Phrase("the air rises at {}", "the air sinks at {}", *SPEED),
    "gravity": Phrase("the ball falls with {} of the stated gravity", "the ball rises with {} of the stated gravity",
                      *SHARE),
    "drag": Phrase("the air slows the ball, with a drag coefficient of {}", "the air drives the ball, with a drag "
                   "coefficient of minus {}", *NUMBER),
    "magnus": Phrase("backspin lifts the ball, with a lift coefficient of {}",
                     "backspin presses the ball down, with a lift coefficient of minus {}", *NUMBER),
    "spin_drag": Phrase("a spinning ball has more drag: its coefficient is {} larger where the ball's rim turns as "
                        "fast as it flies", "a spinning ball has less drag: its coefficient is {} smaller where the "
                        "ball's rim turns as fast as it flies", *NUMBER),
    "drag_reynolds": Phrase("the drag coefficient grows with speed, by {} from 10 to 20 m/s",
                            "the drag coefficient falls with speed, by {} from 10 to 20 m/s", 100.0, " %",
                            " per 10 m/s"),
    "lift_saturation": Phrase("lift levels off as the ball spins faster, at a rate of {}",
                              "lift grows more than in proportion to spin, at a rate of {}", *NUMBER),
    "drag_wear": Phrase("the drag of the balls grows the more they have been shot, by {} at the end",
                        "the drag of the balls falls the more they have been shot, by {} at the end", *SHARE),
    "air_density": Phrase("the forces of the air follow its pressure and temperature, with {} of what the gas law says",
                          "the forces of the air go against its pressure and temperature, with {} of what the gas law "
                          "says", *SHARE),
    "air_change": Phrase("the air is {} denser than when the simulation was fitted",
                         "the air is {} thinner than when the simulation was fitted", *SHARE),
    "buoyancy": Phrase("the air carries part of the ball's weight, {} of that of the air it displaces",
                       "the ball is heavier than stated, by {} of the weight of the air it displaces", *SHARE),
    "added_mass": Phrase("the ball has to move some air along, {} of what theory gives it",
                         "the ball moves as if it were lighter, by {} of the air that theory has it move along",
                         *SHARE),
    "target_height": Phrase("the target stands {} higher than stated", "the target stands {} lower than stated",
                            *LENGTH),
    "rim_catch": Phrase("the opening takes balls that pass {} beyond its stated edges",
                        "the opening is tighter than stated, by {} at each edge", *LENGTH),
}

PLAIN = {"wind_x": "head or tail wind", "wind_y": "crosswind", "wind_z": "rising or sinking air", "magnus": "lift",
         "drag_reynolds": "drag by speed", "spin_drag": "drag by spin", "drag_wear": "drag of worn balls",
         "air_change": "denser or thinner air", "rim_catch": "forgiving rim", "rapid_fire": "rapid fire",
         "free_speed": "a curve of the launch speed", "free_elevation": "a curve of the launch elevation",
         "free_distance": "a curve of the distance", "free_push": "a curve of a push"}

# Columns of shots.csv, and what is derived from them or goes on inside a flight, as people say them.
COLUMNS = {"battery_v": "the battery's voltage", "temperature_c": "the temperature", "pressure_pa": "the air pressure",
           "distance_m": "the distance", "hood_deg": "the hood's angle", "motor_ratio": "the motor ratio",
           "t_s": "the time in the session", "since_last_shot_s": "the time since the last shot",
           "order_in_session": "the order in the session", "robot_speed_m_s": "the robot's speed",
           "shots_of_ball": "the shots that a ball has had", "wheel_dip": "the dip of the wheels",
           "hood_change": "the way the hood came", "exit_speed_m_s": "the launch speed",
           "exit_spin_rev_s": "the launch spin", "exit_deg": "the launch elevation", "ball_id": "the ball",
           "session": "the session", "speed_in_flight_m_s": "the speed in flight",
           "time_in_flight_s": "the time in flight"}


IN_FLIGHT = ("speed_in_flight_m_s", "time_in_flight_s")      # what forces vary with inside one flight


def in_words(column: str) -> str:
    """A column as people say it; one that is the user's own: by its name, and so are two together."""
    return " x ".join(COLUMNS.get(one, one) for one in column.split(" x "))


def plain(name: str) -> str:
    """A term's or column's name as words."""
    term = name.partition(".")[0]
    return PLAIN.get(term, term.replace("_", " "))


def say_effect(term: str, interval: Interval, sentence: str) -> str:
    """The effect with its size and 90 % interval, no full stop; a term without a phrase: its own sentence."""
    phrase = PHRASES.get(term)
    if phrase is None:
        unit = "" if interval.unit == "1" else f" {interval.unit}"
        said = sentence.rstrip(".")
        value, lowest, highest = _together(interval.value, interval.low90, interval.high90)
        return f"{said[:1].lower()}{said[1:]} ({value}{unit}, 90 %: {lowest} to {highest})"
    less = interval.value < 0.0
    factor = -phrase.factor if less else phrase.factor
    low, high = sorted((interval.low90 * factor, interval.high90 * factor))
    value, lowest, highest = _together(interval.value * factor, low, high)
    size = f"{value}{phrase.unit} (90 %: {lowest} to {highest}{phrase.unit})"
    return (phrase.less if less else phrase.more).format(size)


def size_of(name: str, amount: float, unit: str) -> str:
    """An amount of a term's amplitude (or of a free column) as people say it, with what it is told for."""
    phrase = PHRASES.get(name.partition(".")[0])
    if phrase is not None:
        return f"{_number(amount * phrase.factor)}{phrase.unit}{phrase.per}"
    factor, said = scale_of(unit)
    return f"{_number(amount * factor)}{said}"


def scale_of(unit: str) -> tuple[float, str]:
    """(factor, unit with its space) in which a unit of the physics is told."""
    return {"1": SHARE, "rad": (math.degrees(1.0), "°"), "m": LENGTH, "deg": ANGLE, "m/s2": (1.0, " m/s²")}.get(
        unit, (1.0, f" {unit}"))


def _together(value: float, low: float, high: float) -> tuple[str, str, str]:
    """A value and its interval to as many places as leave the interval's width two figures."""
    width = high - low
    places = max(1 - math.floor(math.log10(width) + 1e-9), 0) if 0.0 < width < math.inf else 3
    if places > MOST_PLACES:
        return _number(value), _number(low), _number(high)
    shown = (f"{round(one, places) + 0.0:.{places}f}" for one in (value, low, high))
    return next(shown), next(shown), next(shown)


def _number(value: float) -> str:
    """Two figures, and no exponents where people use none."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    places = max(1 - math.floor(math.log10(abs(value)) + 1e-9), 0)
    return f"{value:.{places}f}" if places <= MOST_PLACES else f"{value:.1e}"
