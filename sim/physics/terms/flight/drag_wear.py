"""Balls whose drag changes as they wear."""

from truearc.sim.physics.term import SHARE, ForceShareTerm, Instrument, amplitude, either_way


class DragWear(ForceShareTerm):
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
