"""Claimed probabilities against what was right."""

import numpy as np
import pytest
from msgspec import structs

from truearc_proof.report.plots import claimed_bins, reliability_png
from truearc_proof.scoring.score_world import Mark

PLAIN = Mark("a", "numpy", "one", "L1", 300, ("wind_x",), 9.0, True, 0.001, "named", ("wind_x",), said=0.9, alias=True,
             right=("wind_x",), unexplained=0.05)


def test_bins_count_what_was_right_of_what_was_claimed() -> None:
    pairs = [(0.1, False), (0.19, True), (0.97, True), (1.0, True), (1.0, False)]
    assert claimed_bins(pairs) == [(pytest.approx(0.145), 1, 2), (pytest.approx(0.99), 2, 3)]
    assert claimed_bins([]) == []


def test_claims_that_are_right_as_often_as_they_say_lie_on_the_diagonal() -> None:
    rng = np.random.default_rng(3)
    said = rng.uniform(0.0, 1.0, 20_000)
    pairs = list(zip(said.tolist(), (rng.uniform(size=len(said)) < said).tolist(), strict=True))
    for mean, hits, of in claimed_bins(pairs):
        assert abs(hits / of - mean) < 4.0 * np.sqrt(mean * (1.0 - mean) / of)


def test_there_is_a_picture_where_probabilities_were_claimed() -> None:
    assert reliability_png([structs.replace(PLAIN, said=None)]) is None
    marks = [PLAIN, structs.replace(PLAIN, level="L0", alias=False), structs.replace(
        PLAIN, verdict="unknown", right=(), alias=None, unexplained=0.8)]
    assert (reliability_png(marks) or b"").startswith(b"\x89PNG")
