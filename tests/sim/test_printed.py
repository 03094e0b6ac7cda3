"""Tables in each of their forms."""

import csv

from truearc.sim.printed import make_text, save_csv
from truearc_proof.table import Table, make_markdown

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
