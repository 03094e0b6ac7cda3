"""Jobs in threads, printed tables, report pages, and statistics against other libraries."""

import csv
import io
import sys
import threading
import time
from importlib.metadata import version

import numpy as np
import pytest
from scipy.linalg import inv
from scipy.stats import binomtest
from sklearn.metrics import brier_score_loss, f1_score, log_loss

from truearc.sim.compute import each_core
from truearc.sim.printed import make_text, save_csv, show_progress
from truearc.sim.report import Origin, make_page
from truearc.sim.statistics import calibration_error, figures_of, invert, reliability, wilson
from truearc_proof.table import Table, make_markdown


def test_results_come_in_the_order_of_the_jobs() -> None:
    def late(job: int) -> int:
        time.sleep(0.01 * (5 - job))
        return job * job

    assert each_core(late, range(5), "squares") == each_core(late, range(5), "squares") == [0, 1, 4, 9, 16]
    assert each_core(late, [], "none") == []


def test_what_is_compiled_first_is_done_alone_and_once() -> None:
    alone: list[str] = []

    def who(job: int) -> None:
        alone.append(threading.current_thread().name)

    each_core(who, range(4), "new code")
    assert alone[0] == threading.current_thread().name and len(alone) == 4
    assert all(name.startswith("each-core") for name in alone[1:])
    alone.clear()
    each_core(who, range(4), "new code")
    assert all(name.startswith("each-core") for name in alone)


def test_an_error_of_a_job_is_raised() -> None:
    def bad(job: int) -> float:
        return 1.0 / (job - 3)

    with pytest.raises(ZeroDivisionError):
        each_core(bad, range(5), "divide")


TABLE = Table("T", ("a", "bbbb"), (("xxxx", "1"), ("y", "22")))


def test_text_lines_up_and_numbers_end_together() -> None:
    assert TABLE.text().splitlines() == ["", "T", "a     bbbb", "xxxx  1", "y     22"]
    assert make_text(TABLE.header, TABLE.rows, right=(1,)) == ["a     bbbb", "xxxx     1", "y       22"]
    assert make_text(("a",), []) == ["a"]


def test_markdown_has_header_rule_and_rows() -> None:
    assert make_markdown(TABLE.header, TABLE.rows).splitlines() == ["| a | bbbb |", "|---|---|", "| xxxx | 1 |",
                                                                    "| y | 22 |"]
    assert TABLE.markdown().startswith("### T\n\n| a |")


def test_csv_comes_back_as_it_was(tmp_path) -> None:
    save_csv(tmp_path / "t.csv", ["a", "b, c"], [[1, "x \"y\""], [None, 0.1]])
    with (tmp_path / "t.csv").open(encoding="utf-8", newline="") as file:
        assert list(csv.reader(file)) == [["a", "b, c"], ["1", "x \"y\""], ["", "0.1"]]
    assert b"\r" not in (tmp_path / "t.csv").read_bytes()


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(("stream", "quiet", "shown"), [
    (Terminal, None, True), (Terminal, True, False), (io.StringIO, None, False), (io.StringIO, False, True)])
def test_progress_shows_the_time_left(monkeypatch, stream, quiet, shown):
    """By default on a terminal only; a command that is not quiet also writes lines to a file."""
    now_s, said = [100.0], stream()
    monkeypatch.setattr("truearc.hw.real.clock.MonotonicClock.now_ns", lambda self: int(now_s[0] * 1e9))
    monkeypatch.setattr(sys, "stderr", said)
    monkeypatch.delitem(sys.modules, "ipykernel", raising=False)
    progress = show_progress("discover", quiet)
    for done in (0.0, 0.1, 0.25, 0.5, 1.0):
        now_s[0] = 100.0 + 40.0 * done
        progress(done, "looking")
    assert bool(said.getvalue()) == shown
    if shown:
        assert "discover:  25%, 30 s left  looking" in said.getvalue()
        assert "discover:  50%, 20 s left" in said.getvalue()
        assert said.getvalue().rstrip(" ").endswith("\n") and "100%" in said.getvalue()


def test_a_default_bar_is_silent_about_what_takes_no_time(monkeypatch):
    monkeypatch.setattr(sys, "stderr", said := Terminal())
    progress = show_progress("fit")
    progress(0.5, "")
    progress(1.0, "done")
    assert said.getvalue() == ""


def body_of(page: str) -> str:
    return page[page.index("<body>"):]


def test_only_the_first_sentence_is_in_the_box() -> None:
    page = body_of(make_page("t", "Off by 9.8 m (90 %: 9 to 10). It is wind & rain. Aim higher.", []))
    assert '<p class="verdict">Off by 9.8 m (90 %: 9 to 10).</p>\n<p>It is wind &amp; rain. Aim higher.</p>' in page
    alone = body_of(make_page("t", "Nothing was found.", [("Next", "<p>a</p>")]))
    assert '<p class="verdict">Nothing was found.</p>\n<h2>Next</h2>' in alone


def test_the_origin_is_at_the_top_and_an_unknown_part_is_left_out() -> None:
    origin = Origin("2026-03-01T10:00:00+01:00", "truearc fit <a>", "ab" * 32)
    page = body_of(make_page("t", "Verdict.", [], origin))
    head = page[:page.index("Verdict.")]
    assert f"2026-03-01 10:00:00+01:00 · truearc {version('truearc')} · data SHA-256 {'ab' * 8}<br>" in head
    assert "<code>truearc fit &lt;a&gt;</code>" in head
    assert f'<p class="origin">truearc {version("truearc")}</p>' in make_page("t", "Verdict.", [])
    assert make_page("t", "Verdict.", [], origin) == make_page("t", "Verdict.", [], origin)


RNG = np.random.default_rng(6)
P_TWO = RNG.uniform(size=300)
P = np.stack([P_TWO, P_TWO * RNG.uniform(size=300)], axis=1)
LEVEL = RNG.integers(0, 3, 300)


@pytest.mark.parametrize(("k", "n"), [(0, 10), (3, 10), (56, 70), (70, 70), (1, 1000)])
def test_wilson_agrees_with_scipy(k, n):
    ours = binomtest(k, n).proportion_ci(0.95, method="wilson")
    assert wilson(k, n) == pytest.approx((ours.low, ours.high), abs=1e-9)


@pytest.mark.parametrize("spread", [0.0, 6.0])
def test_an_information_matrix_is_inverted_whatever_its_units(spread: float) -> None:
    rng = np.random.default_rng(1)
    slopes = rng.normal(size=(60, 12))
    units = 10.0 ** rng.uniform(-spread, spread, 12)
    there = inv(slopes.T @ slopes) / np.outer(units, units)
    np.testing.assert_allclose(invert(slopes.T @ slopes * np.outer(units, units)), there, rtol=1e-9)


@pytest.mark.parametrize("matrix", [np.diag([1.0, 0.0]), np.array([[1.0, 2.0], [2.0, 1.0]]), np.zeros((3, 3))])
def test_one_that_is_not_positive_definite_has_its_pseudo_inverse(matrix: np.ndarray) -> None:
    np.testing.assert_allclose(invert(matrix), np.linalg.pinv(matrix), atol=1e-12)


def test_they_are_scikit_learns() -> None:
    found = figures_of(P, LEVEL)
    classes = np.stack([1.0 - P[:, 0], P[:, 0] - P[:, 1], P[:, 1]], axis=1)
    assert found.log_score == pytest.approx(-log_loss(LEVEL, classes, labels=[0, 1, 2]), abs=1e-6)
    assert found.brier_two == pytest.approx(brier_score_loss(LEVEL >= 1, P[:, 0]))
    assert found.brier_three == pytest.approx(brier_score_loss(LEVEL >= 2, P[:, 1]))
    assert found.f1_three == pytest.approx(f1_score(LEVEL >= 2, P[:, 1] >= 0.5))
    assert found.accuracy == np.mean([(p[0] >= 0.5, p[1] >= 0.5) == (one >= 1, one >= 2)
                                      for p, one in zip(P.tolist(), LEVEL.tolist(), strict=True)])


def test_calibration_error_of_the_perfect_and_of_the_sure_and_wrong() -> None:
    stated = np.repeat([0.25, 0.75], 400)
    true = np.concatenate([np.arange(400) % 4 == 0, np.arange(400) % 4 != 0])
    assert calibration_error(stated, true) == pytest.approx(0.0)
    assert calibration_error(np.ones(10), np.zeros(10, bool)) == 1.0
    table = reliability(stated, true)
    assert table.count.tolist() == [400, 400] and table.came_true.tolist() == [0.25, 0.75]
