"""Importing the falling balls' workbook and list: the same as from the table, every bad sheet, row and line named.

The workbook is made here, with the sheets and columns that its authors' public code reads.
"""

import csv
import io
import sys
from pathlib import Path

import openpyxl
import pytest

import truearc.cli.main as truearc
from tests.proof.importers.test_import_ball_drops import good, write
from tests.sim.same_dataset import assert_same
from truearc.errors import InputError
from truearc_proof.importers.ball_drops import import_ball_drops

HEADER = ("Drop #", "Time (s)", "Height (m)", "Smoothed velocity (m/s)")
SHEETS = {"golfball": "Golf Ball", "tennisball": "Tennis Ball", "bowlingball": "Bowling Ball"}
LIST = """ball            weight(oz)  circumference(cm)
golfball        1.62        13.8
tennisball      2           20.75
bowlingball     81          67.0
volleyball      ??          ??
yellowWiffle    1.4         30.0
wiffleball1     1.1         23.0
"""
Sheets = dict[str, list[list[object]]]


def sheets() -> Sheets:
    """The drops of the other test's table, a sheet a ball."""
    return {sheet: [[row[2], *row[3:6]] for row in good() if row[0] == ball] for ball, sheet in SHEETS.items()}


def workbook(path: Path, content: Sheets, header: tuple[str, ...] = HEADER) -> Path:
    """As the public file is: of the newer kind, whatever its name ends in."""
    book = openpyxl.Workbook()
    book.remove(book.active)
    for name, rows in content.items():
        sheet = book.create_sheet(name)
        for cells in (header, *rows):
            sheet.append(list(cells))
    buffer = io.BytesIO()
    book.save(buffer)
    path.write_bytes(buffer.getvalue())
    return path


def files(home: Path, content: Sheets, balls: str = LIST, header: tuple[str, ...] = HEADER) -> tuple[Path, Path]:
    (home / "balls.txt").write_text(balls)
    return workbook(home / "Ball_drops_data.xls", content, header), home / "balls.txt"


def test_the_workbook_says_the_same_as_the_table(tmp_path: Path) -> None:
    # the table was made with a more exact ounce
    assert_same(import_ball_drops(*files(tmp_path, sheets())), import_ball_drops(write(tmp_path, good())), 3e-6)


def test_a_ball_has_another_name_in_the_list_and_perhaps_no_weight(tmp_path: Path) -> None:
    rows = sheets()["Golf Ball"]
    names = ("Yellow Whiffle Ball", "Whiffle Ball 1", "Volleyball")
    out = tmp_path / "out"
    paths = [str(path) for path in files(tmp_path, dict.fromkeys(names, rows))]
    assert truearc.main(["import", "ball-drops", *paths, "-o", str(out)]) == 0
    with (out / "shots.csv").open(newline="") as file:
        masses = {row["shot_id"]: row["mass_kg"] for row in csv.DictReader(file)}
    balls = ("yellowWiffle", "wiffleball1", "volleyball")
    assert list(masses) == [f"{name}-{drop}" for name in balls for drop in (1, 2)]
    assert masses["volleyball-1"] == ""
    assert float(masses["yellowWiffle-2"]) == pytest.approx(1.4 * 0.0283495)


def test_empty_rows_are_passed_over_and_rows_keep_their_numbers(tmp_path: Path) -> None:
    content = sheets()
    content["Golf Ball"].insert(3, [None] * 4)
    assert len(import_ball_drops(*files(tmp_path, content)).shots) == 4
    content["Golf Ball"][4][2] = "high"
    with pytest.raises(InputError, match=r"xls, sheet Golf Ball:6: height_m: 'high' is not a finite number"):
        import_ball_drops(*files(tmp_path, content))


@pytest.mark.parametrize(("row", "column", "cell", "says"), [
    (5, 1, None, "xls, sheet Golf Ball:7: t_s: is missing"),
    (5, 1, 0.0, "xls, sheet Golf Ball:7: t_s: does not follow the sample before of the same drop"),
    (5, 0, None, "xls, sheet Golf Ball:7: drop: is missing"),
    (5, 2, "", "xls, sheet Golf Ball:7: height_m: is missing"),
    (5, 2, True, "xls, sheet Golf Ball:7: height_m: 'a yes or no' is not a finite number"),
])
def test_a_bad_cell_is_named(tmp_path: Path, row: int, column: int, cell: object, says: str) -> None:
    content = sheets()
    content["Golf Ball"][row][column] = cell
    with pytest.raises(InputError) as caught:
        import_ball_drops(*files(tmp_path, content))
    assert says in str(caught.value)


@pytest.mark.parametrize(("balls", "says"), [
    (LIST.replace("1.62 ", ""), "balls.txt:2: is not a ball's name, weight (oz) and circumference (cm)"),
    (LIST.replace("1.62", "light"), "balls.txt:2: 'light' is not a finite number, nor '??' for unknown"),
    (LIST.replace("13.8", "inf"), "balls.txt:2: 'inf' is not a finite number, nor '??' for unknown"),
    (LIST + "golfball 1 2", "balls.txt:8: 'golfball' stands twice"),
    (LIST.replace("golfball", "golf"), "xls, sheet Golf Ball: its ball, golfball, is not in "),
    (LIST.replace("1.62", "-1"), "xls, sheet Golf Ball:2: mass_kg: -0.0283495 is out of range"),
])
def test_a_ball_without_weight_and_size_is_named(tmp_path: Path, balls: str, says: str) -> None:
    with pytest.raises(InputError) as caught:
        import_ball_drops(*files(tmp_path, sheets(), balls))
    assert says in str(caught.value)


def test_a_sheet_without_its_columns_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    paths = [str(path) for path in files(tmp_path, sheets(), header=("Drop #", "Time (s)", "Height (ft)", "v"))]
    assert truearc.main(["import", "ball-drops", *paths, "-o", str(tmp_path / "out")]) == 2
    assert "xls, sheet Golf Ball:1: column 'Height (m)' is missing" in capsys.readouterr().err
    with pytest.raises(InputError, match=r"xls, sheet Golf Ball:1: column 'Time \(s\)' stands twice"):
        import_ball_drops(*files(tmp_path, sheets(), header=("Drop #", "Time (s)", "Height (m)", "Time (s)")))
    with pytest.raises(InputError, match=r"xls, sheet Notes: its ball, notes, is not in"):
        import_ball_drops(*files(tmp_path, sheets() | {"Notes": []}))


def test_a_workbook_that_is_none_or_cut_short_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    book, balls = files(tmp_path, sheets())
    whole = book.read_bytes()
    for data in (whole[:len(whole) // 2], whole[:100], b"", b"PK\x03\x04 no more", b"\xd0\xcf\x11\xe0 an older kind",
                 b"ball,drop"):
        book.write_bytes(data)
        assert truearc.main(["import", "ball-drops", str(book), str(balls), "-o", str(tmp_path / "out")]) == 2
        said = capsys.readouterr()
        assert "Ball_drops_data.xls: not a readable Excel workbook" in said.err and not said.out
    book.unlink()
    with pytest.raises(InputError, match=r"xls: No such file"):
        import_ball_drops(book, balls)


def test_without_the_package_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    paths = files(tmp_path, sheets())
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    with pytest.raises(InputError, match=r"needs openpyxl: pip install \./proof"):
        import_ball_drops(*paths)


@pytest.mark.data
def test_the_real_falls_are_the_same_out_of_a_workbook(tmp_path: Path, data_dir: Path) -> None:
    table = data_dir / "real/ball_drops.csv"
    content: Sheets = {}
    listed: dict[str, str] = {}
    with table.open(newline="") as file:
        for row in csv.DictReader(file):
            samples = [float(row[name]) for name in ("drop", "t_s", "height_m", "velocity_mps")]
            content.setdefault(row["sheet"], []).append(list[object](samples))
            mass, diameter = row["mass_kg"], row["diameter_m"]
            listed[row["ball"]] = (f"{float(mass) / 0.0283495} {float(diameter) * 100.0 * 3.141592653589793}"
                                   if mass else "?? ??")
    balls = "ball weight(oz) circumference(cm)\n" + "\n".join(f"{name} {of}" for name, of in listed.items())
    assert_same(import_ball_drops(*files(tmp_path, content, balls)), import_ball_drops(table), 1e-9)
