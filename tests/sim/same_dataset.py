"""Whether two files made the same dataset, within the digits that a table was rounded to."""

import numpy as np

from truearc.sim.data.dataset import Dataset


def assert_same(dataset: Dataset, other: Dataset, rounding: float) -> None:
    """Facts, names, texts, numbers (nan is nan) and tracks; rounding: largest difference of a number."""
    assert (dataset.name, dataset.shots.shot_id, dataset.shots.texts) == (
        other.name, other.shots.shot_id, other.shots.texts)
    assert dataset.shots.numbers.keys() == other.shots.numbers.keys()
    for name, column in other.shots.numbers.items():
        np.testing.assert_allclose(dataset.shots.number(name), column, rtol=0.0, atol=rounding, err_msg=name)
    assert (dataset.tracks is None) == (other.tracks is None)
    if dataset.tracks is not None and other.tracks is not None:
        for name, column in vars(other.tracks).items():
            np.testing.assert_allclose(getattr(dataset.tracks, name), column, rtol=0.0, atol=rounding, err_msg=name)
    for name in ("launcher", "target", "air", "noise", "believe"):
        assert getattr(dataset.facts, name) == getattr(other.facts, name)
    assert abs(dataset.facts.ball.mass_kg - other.facts.ball.mass_kg) <= rounding
    assert abs(dataset.facts.ball.radius_m - other.facts.ball.radius_m) <= rounding
