"""Terms of the flight stage: effects of the air and of the forces on the ball."""

import math

import jax.numpy as jnp

from truearc.sim.physics import term
from truearc.sim.physics.term import SHARE, Instrument, Phrase, Vec, amplitude, either_way, length, scale

LEAST = 0.1                           # of 1 + rate S, should a search try rates far below 0


def drag_per_m(rig: term.Rig) -> float:
    """Return rho A / 2 m in 1/m: the deceleration per drag coefficient and speed squared (the paper's Eq. 3)."""
    return 0.5 * (math.pi * rig.ball.radius_m**2) * rig.air.density_kg_m3 / rig.ball.mass_kg


def displaced_share(rig: term.Rig) -> float:
    """Return the mass of the air that the ball displaces as a share of the ball's."""
    return rig.air.density_kg_m3 * (4.0 / 3.0 * math.pi * rig.ball.radius_m**3) / rig.ball.mass_kg


class SpinDecay(term.AirTerm):
    """spin = spin at release x exp(-rate_per_s x time since release)."""

    order = 10, "what spin is left, before the forces that it makes"
    parameters = amplitude("rate_per_s", "1/s", 0.0, 5.0, sd=0.4, meaning="rate of decay, 1 / time constant",
                           source="golf balls lose 3 to 4 % per second; a light ball of 18 cm at 10 m/s a quarter, by "
                           "the law seen for baseballs (Nathan 2008)",
                           reason="from a few per cent (golf) to the quarter by that law, and twice as much for foam")
    direction = "vertical"
    sentence = "The ball loses spin in flight."
    phrase = either_way("the ball <loses|gains> spin in flight, with a time constant of {}", term.SECONDS,
                        " (time constant)", rate=True)
    instrument = Instrument("spin_film_early_late", "the spin of a marked ball as it leaves and as it lands", 0.1)

    def meet(self, rig: term.Rig, values: term.Values, ball: term.BallState) -> term.BallState:
        return ball._replace(spin_rev_s=scale(jnp.exp(-values["rate_per_s"] * ball.time_s), ball.spin_rev_s))


class WindX(term.WindTerm):
    """The ball's velocity through the air is its own velocity minus speed_m_s toward the target."""

    order = 20, "what air the ball meets, before its forces"
    parameters = term.wind_speed("wind toward the target")
    direction = "along"
    label = "head or tail wind"
    sentence = "There is wind toward the target, or from it."
    phrase = either_way("there is wind of {} <toward|from> the target", term.SPEED)


class WindY(term.WindTerm):
    """The ball's velocity through the air is its own velocity minus speed_m_s to the left."""

    order = 30, "what air the ball meets, before its forces"
    parameters = term.wind_speed("wind to the left")
    direction = "lateral"
    label = "crosswind"
    record = "tracks of the ball"
    sentence = "There is wind across the flight."
    phrase = either_way("there is wind of {} to the <left|right>", term.SPEED)


class WindZ(term.WindTerm):
    """The ball's velocity through the air is its own velocity minus speed_m_s upward."""

    order = 40, "what air the ball meets, before its forces"
    parameters = term.wind_speed("wind upward")
    direction = "vertical"
    label = "rising or sinking air"
    sentence = "The air rises or sinks where the balls fly."
    phrase = either_way("the air <rises|sinks> at {}", term.SPEED)


class Gravity(term.FlightTerm):
    """a = -g in z; `scale` multiplies the rig's own g and is 1 unless a fit says otherwise."""

    order = 100, "the one force that is not the air's"
    parameters = (term.Parameter("scale", "1", 0.0, 2.0, 1.0, "1 by definition; rig.toml states g",
                                 meaning="gravity as a multiple of the stated one"),)
    direction = "vertical"
    always = True
    sentence = "The ball falls under its weight."
    phrase = either_way("the ball <falls|rises> with {} of the stated gravity", SHARE)
    instrument = None

    def acceleration(self, rig: term.Rig, values: term.Values, ball: term.BallState, forces: term.Forces) -> Vec:
        return Vec(0.0, 0.0, -rig.world.gravity_m_s2 * values["scale"])


class Drag(term.FlightTerm):
    """F = (cd / 2) A rho v^2 against the velocity, with A = pi r^2."""

    order = 110, "a force by itself, before those that are shares of it"
    parameters = amplitude("cd", "1", 0.0, 5.0, scale="log", centre=0.5, sd=0.35, meaning="drag coefficient",
                           source="spheres at the speeds of launchers: 0.4 to 0.5 smooth (Achenbach 1972), 0.5 to 0.65 "
                           "felt (Mehta et al. 2008); range: the paper's search",
                           reason="a factor of 1.4 either way covers these; the paper's 0.91 is two deviations off",
                           by_ball=0.08, fit_each_ball=True)
    direction = "along"
    sentence = "The air slows the ball in proportion to the square of its speed."
    phrase = either_way("the air <slows|drives> the ball, with a drag coefficient of <|minus >{}")
    instrument = Instrument("fall_film", "the fall of a ball from a known height", 0.05, True)

    def acceleration(self, rig: term.Rig, values: term.Values, ball: term.BallState, forces: term.Forces) -> Vec:
        return scale(-values["cd"] * drag_per_m(rig) * length(ball.velocity_m_s), ball.velocity_m_s)


class Magnus(term.FlightTerm):
    """F = cl (4/3) (4 pi^2 r^3 rho) s x v with s in revolutions per second: backspin lifts."""

    order = 120, "a force by itself, before those that are shares of it"
    parameters = amplitude("cl", "1", 0.0, 5.0, scale="linear", centre=0.1, sd=0.15, meaning="lift coefficient",
                           source="the paper's search range; 1 is the inviscid value",
                           reason="a lift of k r w / v in the usual form, k near 0.5 to 1, is cl 0.1 to 0.2 with the "
                           "true spin, half of that with the paper's (twice as fast); smooth balls may reverse it",
                           by_ball=0.08, below="so backspin presses the ball down: make sure of each wheel's clock_deg "
                           "in rig.toml (0 touches from above, 180 from below), or of the sign of exit_spin_rev_s "
                           "(backspin is positive); only smooth balls do so")
    direction = "vertical"
    label = "lift"
    sentence = "The ball's spin bends its path, in proportion to spin and speed."
    phrase = either_way("backspin <lifts the ball|presses the ball down>, with a lift coefficient of <|minus >{}")
    topspin_phrase = either_way("topspin <presses the ball down|lifts the ball>, with a lift coefficient of "
                                "<|minus >{}")
    instrument = Instrument("shots_without_spin", "where five shots without spin go", 0.05)

    def acceleration(self, rig: term.Rig, values: term.Values, ball: term.BallState, forces: term.Forces) -> Vec:
        per_rev = 4.0 / 3.0 * 4.0 * math.pi**2 * rig.ball.radius_m**3 * rig.air.density_kg_m3 / rig.ball.mass_kg
        return scale(values["cl"] * per_rev, term.cross(ball.spin_rev_s, ball.velocity_m_s))


class SpinDrag(term.FlightTerm):
    """cd grows by share S^2 with S = 2 pi r spin / speed: a = -(share S^2) (rho A / 2 m) v^2 against the velocity."""

    order = 130, "a force by itself, which shares of drag leave alone"
    parameters = amplitude("share", "1", -2.0, 5.0, sd=0.3, meaning="growth of cd with the spin parameter squared",
                           source="seen of golf balls, baseballs and, in tunnels only, tennis balls (Cross & Lindsey "
                           "2013)",
                           reason="tunnel data of spinning balls rise by about as much as S squared")
    direction = "along"
    positive = 0.9                    # every tunnel that has looked found more drag with more spin
    label = "drag by spin"
    sentence = "The air slows a spinning ball more than one without spin."
    phrase = either_way("a spinning ball has <more|less> drag: its coefficient is {} <larger|smaller> where the ball's "
                        "rim turns as fast as it flies")
    instrument = Instrument("shots_without_spin", "where five shots without spin go", 0.15)

    def acceleration(self, rig: term.Rig, values: term.Values, ball: term.BallState, forces: term.Forces) -> Vec:
        rim_m = 2.0 * math.pi * rig.ball.radius_m
        per_m = values["share"] * (drag_per_m(rig) * rim_m**2)
        pace = term.dot(ball.spin_rev_s, ball.spin_rev_s) / length(ball.velocity_m_s)
        return scale(term.times(-1.0, term.times(per_m, pace)), ball.velocity_m_s)


class DragReynolds(term.ForceShareTerm):
    """cd x (1 + slope (v / at_m_s - 1)): cd is the coefficient at at_m_s."""

    of = "drag"
    order = 140, "a share of drag"
    parameters = (
        *amplitude("slope", "1", -1.0, 1.0, sd=0.3, meaning="relative change of drag coefficient per relative speed",
                   source="cd falls from 0.5 to 0.1-0.2 as rough balls pass Re 1e5-3e5 (Hong 2020); tennis balls keep "
                   "theirs",
                   reason="a ball of 18 cm at 8 to 15 m/s is just below that fall or at its foot"),
        term.Parameter("at_m_s", "m/s", 1.0, 30.0, 10.0,
                       "a usual exit speed; it only sets the speed at which cd is stated",
                       meaning="speed at which the drag coefficient is stated"))
    direction = "along"
    label = "drag by speed"
    sentence = "The drag coefficient changes with the ball's speed."
    phrase = either_way("the drag coefficient <grows|falls> with speed, by {} from 10 to 20 m/s", SHARE, " per 10 m/s")
    instrument = Instrument("fall_film_two_heights", "the fall of a ball from two heights", 0.2, True)

    def share(self, rig: term.Rig, values: term.Values, ball: term.BallState) -> term.Number:
        return values["slope"] * (length(ball.velocity_m_s) / values["at_m_s"] - 1.0)


class LiftSaturation(term.ForceShareTerm):
    """Lift / (1 + rate S) with S = 2 pi r spin / speed."""

    of = "magnus"
    order = 150, "a share of the lift"
    parameters = amplitude("rate", "1", 0.0, 10.0, sd=1.0, meaning="how soon lift levels off as spin grows",
                           source="lift of baseballs depends on S alone and flattens with it (Nathan 2008)",
                           reason="tunnel data of sports balls flatten at S of about 0.3 to 1")
    direction = "vertical"
    sentence = "The lift no longer grows in proportion to the spin when the ball spins fast."
    phrase = either_way("lift <levels off as the ball spins faster|grows more than in proportion to spin>, at a rate "
                        "of {}")
    instrument = Instrument("spin_film", "the spin of a marked ball as it leaves", 0.3)

    def share(self, rig: term.Rig, values: term.Values, ball: term.BallState) -> term.Number:
        bend_m_s = values["rate"] * (2.0 * math.pi * rig.ball.radius_m) * length(ball.spin_rev_s)
        speed_m_s = length(ball.velocity_m_s)
        return -bend_m_s / jnp.maximum(speed_m_s + bend_m_s, LEAST * speed_m_s)


class DragWear(term.ForceShareTerm):
    """drag x (1 + share x age); age runs from 0 to 1 through the session, or through a ball's own shots."""

    of = "drag"
    order = 160, "a share of drag"
    parameters = amplitude("share", "1", -0.9, 2.0, sd=0.1, meaning="relative growth of drag by a session's end",
                           source="worn tennis balls have less drag than new ones (Goodwill 2004), torn foam has more",
                           reason="none to fifteen per cent in a session, in either direction")
    direction = "along"
    label = "drag of worn balls"
    follows = "age"
    sentence = "The drag of the balls changes the more they have been shot."
    phrase = either_way("the drag of the balls <grows|falls> the more they have been shot, by {} at the end", SHARE)
    instrument = Instrument("fall_film_worn_balls", "the fall of new and worn balls side by side", 0.05, True)


class AirDensity(term.AirShareTerm):
    """All forces of the air x (1 + share x the density's known relative deviation from its median)."""

    order = 170, "a share of all forces of the moving air"
    parameters = amplitude("share", "1", 0.0, 2.0, sd=1.0, meaning="part of the gas law that the forces follow",
                           source="1 by definition: forces of the air are proportional to its density, 3.4 % for 10 K",
                           reason="0 is a simulation without weather, 1 the ideal gas")
    follows = "density"
    law_sd = 0.2
    sentence = "The forces of the air change with its pressure and temperature."
    phrase = either_way("the forces of the air <follow|go against> its pressure and temperature, with {} of what the "
                        "gas law says", SHARE)
    instrument = Instrument("fall_film_cold_warm", "the fall of a ball on a cold and on a warm day", 0.3, True)


class AirChange(term.AirShareTerm):
    """All forces of the air x (1 + share). Fitted drag and lift absorb it completely, unless both were known before."""

    order = 180, "a share of all forces of the moving air"
    parameters = amplitude("share", "1", -0.5, 1.0, sd=0.08, meaning="air density above that of the earlier session",
                           source="forces of the air are proportional to its density: 3.4 % for 10 K, 12 % for "
                           "1000 m of altitude",
                           reason="from a cold hall to a hot one, or from the coast to the hills")
    label = "denser or thinner air"
    relative = True
    sentence = "The air is denser or thinner than when the simulation was fitted."
    phrase = either_way("the air is {} <denser|thinner> than when the simulation was fitted", SHARE)
    instrument = Instrument("thermometer_barometer", "temperature and pressure, and those of the session before", None)


class Buoyancy(term.FlightTerm):
    """share x (rho V / m) g upward, Archimedes' force; 1 is all of it."""

    order = 190, "air at rest: after the shares of the moving air's forces"
    parameters = amplitude("share", "1", -1.0, 4.0, sd=1.0, meaning="share of the displaced air's weight that lifts",
                           source="1 by Archimedes' principle: 2.5 % of the weight of a foam ball",
                           reason="0 is a simulation without it, 1 is the theory")
    direction = "vertical"
    law_sd = 0.2
    sentence = "The air that the ball displaces carries part of its weight."
    phrase = Phrase("the air carries part of the ball's weight, {} of that of the air it displaces",
                    "the ball is heavier than stated, by {} of the weight of the air it displaces", *SHARE)
    instrument = Instrument("ball_scale", "ball mass with a scale", 0.3)

    def acceleration(self, rig: term.Rig, values: term.Values, ball: term.BallState, forces: term.Forces) -> Vec:
        return Vec(0.0, 0.0, values["share"] * (displaced_share(rig) * rig.world.gravity_m_s2))


class AddedMass(term.FlightTerm):
    """All accelerations / (1 + share x rho V / 2 m): half the displaced air for a sphere in potential flow."""

    order = 200, "a share of all forces"
    parameters = amplitude("share", "1", -1.0, 4.0, sd=1.0, meaning="share of half the displaced mass that moves along",
                           source="1 for a sphere in a fluid without friction: half the displaced mass (Lamb 1932)",
                           reason="0 is a simulation without it, 1 is the theory")
    direction = "vertical"
    law_sd = 0.2
    sentence = "The ball carries air along and is harder to speed up or slow down than its mass says."
    phrase = Phrase("the ball has to move some air along, {} of what theory gives it", "the ball moves as if it were "
                    "lighter, by {} of the air that theory has it move along", *SHARE)
    instrument = Instrument("ball_scale", "ball mass with a scale", 0.3)

    def acceleration(self, rig: term.Rig, values: term.Values, ball: term.BallState, forces: term.Forces) -> Vec:
        heavier = values["share"] * (0.5 * displaced_share(rig))
        return scale(-heavier / (1.0 + heavier), term.total(forces.values()))
