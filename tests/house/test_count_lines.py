"""The line counter counts code and nothing else."""

from tools.count_lines import Count, count_files, count_source, python_files

SOURCE = '''"""Module text
over two lines."""

# a comment
TABLE = """first
second"""


def outer(x):
    """One line."""

    def inner(y):  # a comment behind code
        return (y +
                1)
    return inner(x)
'''


def test_documentation_comments_and_blank_lines_are_not_counted():
    assert count_source(SOURCE) == Count(7, (5, 3))


def test_files_of_a_folder_are_counted_together(tmp_path):
    (tmp_path / "below").mkdir()
    for name in ("one.py", "below/two.py"):
        (tmp_path / name).write_text(SOURCE)
    (tmp_path / "notes.md").write_text(SOURCE)
    assert count_files(python_files(tmp_path)) == Count(14, (5, 3, 5, 3))
    assert python_files(tmp_path / "one.py") == [tmp_path / "one.py"]
