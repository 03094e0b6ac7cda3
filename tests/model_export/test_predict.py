"""Rows of the gate's predictions, character by character."""


import numpy as np
import pytest

from truearc.api.results import Table
from truearc.errors import InputError
from truearc.model_export.verify import HEADER, features_of, rate_shots
from truearc.robot.gate import Gate
from truearc.sim.data.dataset import Shots


class Halves:
    """p_two = distance / 10, p_three = ratio / 2, novelty = 1 / distance; no number at all beyond 45 degrees."""

    def run(self, outputs: tuple[str, ...], inputs: dict[str, np.ndarray]) -> list[np.ndarray]:
        features = inputs["features"]
        p = np.column_stack([features[:, 0] / 10, features[:, 1] / 2]).astype(np.float32)
        p[features[:, 2] > 45.0] = np.nan
        return [p, 1.0 / features[:, :1]]


GATE = Gate(Halves(), ((1.0, 6.0), (0.0, 1.0), (0.0, 90.0)), "", {})


def make_ratings(gate: Gate, shots: Shots, name: str) -> str:
    return Table(HEADER, tuple(rate_shots(gate, shots, name))).to_csv()


def make_shots(**columns: list[float]) -> Shots:
    numbers = {"distance_m": [5.0, 7.5, 2.5], "motor_ratio": [0.5, 0.25, 1.0], "hood_deg": [30.0, 40.0, 50.0]}
    return Shots(("a", "b,c", "d"), {name: np.array(values) for name, values in (numbers | columns).items()}, {})


def test_rows_to_the_letter() -> None:
    assert make_ratings(GATE, make_shots(distance_m=[4.0, 8.0, 2.0]), "DIR") == (
        'shot_id,p_two,p_three,in_domain,novelty\na,0.4000000059604645,0.25,true,0.25\n"b,c",0.800000011920929,0.125,false,0.125\nd,,,false,\n')


def test_missing_features_are_named_with_their_shots() -> None:
    with pytest.raises(InputError, match=r"DIR: column hood_deg: no value for shot_id b,c$"):
        make_ratings(GATE, make_shots(hood_deg=[30.0, np.nan, 50.0]), "DIR")
    many = Shots(tuple("abcdefgh"), {"distance_m": np.ones(8), "hood_deg": np.ones(8)}, {})
    with pytest.raises(InputError, match="column motor_ratio: no value for shot_id a, b, c, d, e and 3 more"):
        features_of(many, "DIR")
