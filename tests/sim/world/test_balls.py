import statistics

import pytest

from truearc.sim.world.options import Options
from truearc.sim.world.scene import MASS_SHARE, RACK, SEAT_M, STIFFNESS_SHARE, Rack

CALM = Options(scatter_scale=0.0)


def test_every_ball_comes_once_before_any_comes_again() -> None:
    rack = Rack(3, Options())
    for round_ in range(4):
        ids = [rack.ball(round_ * RACK + k).ball_id for k in range(RACK)]
        assert len(set(ids)) == RACK
    assert ids != [rack.ball(k).ball_id for k in range(RACK)]


def test_a_shot_is_the_same_whenever_it_is_looked_at() -> None:
    rack = Rack(3, Options())
    later = rack.ball(40)
    assert rack.ball(7) == Rack(3, Options()).ball(7)
    assert rack.ball(40) == later
    assert rack.ball(7) != Rack(4, Options()).ball(7)


def test_one_ball_keeps_its_mass_but_not_its_seat() -> None:
    rack = Rack(3, Options())
    balls = [rack.ball(k) for k in range(10 * RACK)]
    mine = [ball for ball in balls if ball.ball_id == "ball05"]
    assert len(mine) == 10
    assert len({ball.mass_kg for ball in mine}) == 1
    assert len({ball.seat_m for ball in mine}) == 10


@pytest.mark.parametrize(("scale", "least", "most"), [(1.0, 0.8, 1.2), (2.0, 1.6, 2.4)])
def test_the_scatter_is_as_wide_as_it_says(scale: float, least: float, most: float) -> None:
    options = Options(scatter_scale=scale)
    balls = [Rack(seed, options).ball(k) for seed in range(40) for k in range(RACK)]
    assert least < statistics.stdev(ball.mass_kg / 0.14 for ball in balls) / MASS_SHARE < most
    assert least < statistics.stdev(ball.stiffness_n_m / 8000.0 for ball in balls) / STIFFNESS_SHARE < most
    assert least < statistics.stdev(ball.seat_m for ball in balls) / SEAT_M < most


def test_without_scatter_all_balls_are_as_drawn() -> None:
    rack = Rack(3, CALM)
    balls = {rack.ball(k)._replace(ball_id="") for k in range(3 * RACK)}
    assert len(balls) == 1
    assert balls.pop() == ("", 0.14, 0.0889, 8000.0, 1.0, 1.0, 0.0, 0.0)


def test_wear_is_counted_for_each_ball() -> None:
    rack = Rack(3, Options(scatter_scale=0.0, wear_stiffness_per_shot=0.05, wear_radius_per_shot=0.001,
                           wear_friction_per_shot=0.02))
    mine, other = rack.ball(0).ball_id, rack.ball(1).ball_id
    rack.use(0)
    again = [ball for ball in (rack.ball(k) for k in range(RACK, 3 * RACK)) if ball.ball_id == mine]
    assert [ball.stiffness_n_m for ball in again] == pytest.approx([0.95 * 8000.0] * 2)
    assert [ball.radius_m for ball in again] == pytest.approx([0.999 * 0.0889] * 2)
    assert [ball.friction_scale for ball in again] == pytest.approx([0.98] * 2)
    assert all(ball.stiffness_n_m == 8000.0 for ball in (rack.ball(k) for k in range(RACK, 2 * RACK))
               if ball.ball_id == other)


def test_scales_and_warmth_multiply() -> None:
    ball = Rack(3, Options(scatter_scale=0.0, ball_mass_scale=1.1, ball_radius_scale=0.98, ball_stiffness_scale=0.5,
                           ball_friction_scale=0.8, temperature_c=30.0)).ball(0)
    assert (ball.mass_kg, ball.radius_m, ball.friction_scale) == pytest.approx((0.154, 0.087122, 0.8))
    assert ball.stiffness_n_m == pytest.approx(8000.0 * 0.5 * 0.9)
