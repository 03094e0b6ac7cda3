"""Commands as a user meets them: help, completion, typos, bad input, missing packages, and a quick start."""

import argparse
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from truearc.cli.main import Command, list_commands, main, make_parser

COMMANDS = list_commands()


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_help_has_an_example(command: Command, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main([*command.name.split(), "--help"])
    assert stop.value.code == 0
    said = capsys.readouterr().out
    assert f"usage: truearc {command.name}" in said
    assert " ".join(command.load().description.split()) in " ".join(said.split())
    assert f"truearc {command.name} " in said.partition("example:")[2]


def test_help_lists_every_command_under_its_group(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    lines = capsys.readouterr().out.splitlines()
    heading = ""
    listed = {}
    for line in lines[1:]:
        if line.startswith("  "):
            listed[line[2:20].strip()] = heading
        else:
            heading = line.partition(":")[0]
    assert listed == {command.name: command.group for command in COMMANDS}
    assert {"prove", "reproduce"} <= {name for name, group in listed.items() if group == "proof"}


def test_help_whose_reader_has_had_enough_ends_quietly() -> None:
    started = subprocess.Popen([sys.executable, "-m", "truearc", "--help"], stdout=subprocess.PIPE,
                               stderr=subprocess.PIPE)
    assert started.stdout is not None and started.stderr is not None
    started.stdout.close()
    assert started.stderr.read() == b"" and started.wait() == 0
    started.stderr.close()


@pytest.mark.parametrize("prefix", ["paper", "session"])
def test_a_prefix_lists_its_commands(prefix: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([prefix, "--help"]) == 0
    said = capsys.readouterr().out
    for command in COMMANDS:
        assert (f"  {command.name} " in said) == command.name.startswith(f"{prefix} ")
    assert main([prefix]) == 2


@pytest.mark.parametrize(("typed", "meant"), [
    ("disover", "truearc discover"), ("emulat", "truearc emulate"), ("paper fitt", "truearc paper fit"),
    ("session reply", "truearc session replay"), ("conver", "truearc session convert"), ("provee", "truearc prove")])
def test_a_typo_gets_the_nearest_command(typed: str, meant: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*typed.split(), "x"]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"truearc: {typed}: not a command; did you mean: {meant}")


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """What one line on stderr says behind the command's name; exit code 2."""
    assert main(words) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1 and err.startswith("truearc ")
    return err.partition(": ")[2].rstrip()


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_every_command_refuses_an_unknown_option(command: Command, capsys: pytest.CaptureFixture[str]) -> None:
    words = command.name.split()
    assert refused([*words, "--xyzzyx"], capsys).startswith("--xyzzyx: there is no such option; give one of: ")
    if command.progress:
        assert refused([*words, "--quie"], capsys) == "--quie: there is no such option; did you mean --quiet?"
    else:
        assert refused([*words, "--quiet"], capsys).startswith("--quiet: there is no such option")


def needed_by(command: Command) -> list[argparse.Action]:
    """The arguments that a command cannot do without."""
    return [action for action in make_parser(command)._actions if action.required and action.nargs != "*"]


@pytest.mark.parametrize("command", [one for one in COMMANDS if needed_by(one)], ids=lambda command: command.name)
def test_every_missing_argument_is_named_with_the_example(command, capsys):
    names, _, example = refused(command.name.split(), capsys).partition(": missing; example: ")
    assert names == ", ".join("/".join(action.option_strings) or str(action.metavar or action.dest)
                              for action in needed_by(command))
    assert example == command.example


@pytest.mark.parametrize(("words", "said"), [
    ("discover d --seeed 1", "--seeed: there is no such option; did you mean --seed?"),
    ("discover --seeed=1", "--seeed: there is no such option; did you mean --seed?"),
    ("discover d --seed x", "--seed: 'x' is not a whole number; give one such as 0"),
    ("discover d --false-alarm x", "--false-alarm: 'x' is not a number; give one such as 0.5"),
    ("predict d --cd nan --cl 0", "--cd: got nan; expected at least 0"),
    ("discover d --seed", "--seed: its value is missing; example: truearc discover "),
    ("session convert s --to cvs -o x", "--to: 'cvs' is not a choice; did you mean csv?"),
    ("session convert s --to z -o x", "--to: 'z' is not a choice; give one of: csv, mcap, parquet, wpilog"),
    ("identifiability r --level L3", "--level: 'L3' is not a choice; give one of: L0, L1, L2"),
    ("paper train --real r -o w --epochs 2 --steps 3", "--steps: excludes --epochs; give one of them"),
    ("sysid --emulate=yes", "--emulate: takes no value, got 'yes'; leave it out"),
    ("export a b -o g", "b: not an argument of this command; example: truearc export "),
    ("export -o", "-o/--out: its value is missing; example: truearc export ")])
def test_an_unusable_argument_is_named_with_what_to_do(words, said, capsys):
    assert refused(words.split(), capsys).startswith(said)


# as an install of truearc alone sees its distributions
ALONE = """import importlib.metadata as metadata, sys
every = metadata.entry_points
metadata.entry_points = lambda **of: [point for point in every(**of) if point.dist.name != "truearc-proof"]
from truearc.cli.main import main
sys.exit(main({words!r}))
"""


def alone(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", ALONE.format(words=[*words])], capture_output=True, text=True)


def test_alone_it_says_what_proof_would_add_and_imports_any_teams_logs() -> None:
    install = "pip install ./proof (in a checkout of the repository)"
    done, listed = alone("prove", "--worlds", "1"), alone("--help").stdout
    assert (done.returncode, done.stderr) == (2, f"truearc prove: needs truearc-proof: {install}\n")
    assert "  discover " in listed and not any(f"  {name} " in listed for name in ("prove", "reproduce"))
    shown, refused = alone("import", "--help"), alone("import", "mpi", "a", "-o", "d")
    assert shown.returncode == 0 and "{csv,wpilog}" in shown.stdout and "pip install ./proof" in shown.stdout
    assert refused.returncode == 2 and "give one of: csv, wpilog" in refused.stderr


# those with a file of a kind of its own: tests/cli/test_file_kinds.py
@pytest.mark.parametrize("words", [
    ["session", "recover", "nowhere"], ["predict", "--gate", "nowhere.onnx", "nowhere"], ["discover", "nowhere"],
    ["train", "--real", "nowhere", "--coefficients", "nowhere.toml", "-o", "w"],
    ["paper", "train", "--real", "nowhere", "-o", "w"], ["paper", "sweep", "--real", "nowhere", "-o", "w"],
    ["paper", "synth", "--rig", "nowhere.toml", "--coefficients", "nowhere.toml", "-o", "d"], ["vision", "nowhere.jpg"],
    ["vision-calibrate", "--distances", "nowhere.csv"], ["vision-tune", "nowhere"],
    ["import", "mpi", "nowhere.csv", "nowhere.csv", "-o", "d"], ["run", "--config", "nowhere.toml"],
    ["deploy", "pi@robot", "--config", "nowhere.toml"],
    ["emulate", "--trials", "1", "--out", "s", "--config", "nowhere.toml"],
    ["emulate", "--trials", "1", "--out", "s", "--world", "nowhere.toml"],
    ["emulate", "--trials", "1", "--out", "s", "--gate", "nowhere.onnx"]], ids=" ".join)
def test_a_missing_file_is_named_with_exit_code_2(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    said = capsys.readouterr().err
    command = next(one.name for one in COMMANDS if " ".join(words).startswith(f"{one.name} ")
                   and len(one.name.split()) == (2 if words[0] in ("paper", "session") else 1))
    assert "nowhere" in said and f"truearc {command}: " in said


@pytest.mark.parametrize("words", [
    ["emulate", "--trials", "1", "--out", "s", "--seed", "-1"], ["demo", "--seed", "-1"], ["demo", "--seed", "x"],
    ["emulate", "--trials", "0", "--out", "s"],
    ["emulate", "--trials", "1", "--out", "a_file/s"], ["demo", "--out", "a_file"]])
def test_impossible_values_are_refused_and_leave_nothing_behind(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a_file").touch()
    assert main([*words, "--quiet"]) == 2
    assert capsys.readouterr().err.startswith(f"truearc {words[0]}: ")
    assert [path.name for path in tmp_path.iterdir()] == ["a_file"]


@pytest.mark.parametrize(("package", "install", "words"), [
    ("jax", "'truearc[sim]'", ["discover", "x"]), ("sklearn", "./proof", ["reproduce", "-o", "x", "--quick"])])
def test_a_missing_package_says_what_to_install(package, install, words, tmp_path):
    code = f"import sys; sys.modules[{package!r}] = None\nfrom truearc.cli.main import main\nsys.exit(main({words!r}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 2 and f"pip install {install}" in done.stderr and "Traceback" not in done.stderr


# --- start-up: help loads no numerical library, and answers at once

HEAVY = ("cantools", "can", "cv2", "jax", "matplotlib", "mujoco", "numba", "numpy", "onnx", "onnxruntime", "optax",
         "pandas", "pyarrow", "scipy", "serial", "sklearn", "shtab")
# One interpreter: each command's parser in turn, and what is loaded after it.
CODE = f"""
import sys
from truearc.cli.main import list_commands, main, make_parser
for command in list_commands():
    make_parser(command).format_help()
    for name in {HEAVY!r}:
        if name in sys.modules:
            print(command.name, name)
            sys.modules.pop(name)
main(["--help"])
print("then", *(name for name in {HEAVY!r} if name in sys.modules))
"""


def run(code: str) -> list[str]:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def test_no_help_loads_a_numerical_library() -> None:
    lines = run(CODE)
    at = next(row for row, line in enumerate(lines) if line.startswith("usage: truearc COMMAND"))
    assert lines[:at] == []
    assert lines[-1] == "then"


def test_the_list_of_commands_imports_no_command_of_ours() -> None:
    loaded = run("import sys; from truearc.cli.main import main; main(['--help']);"
                 "print('loaded', *(name for name in sys.modules if name.startswith('truearc.')))")[-1].split()
    ours = {command.run.partition(":")[0] for command in list_commands() if not command.distribution}
    assert not (ours - {"truearc.cli.main"}) & set(loaded)


# --- completion, as bash itself completes

ASK = """
source "$1"; shift
COMP_WORDS=(truearc "$@"); COMP_CWORD=$#; COMPREPLY=()
_shtab_truearc truearc "${COMP_WORDS[$COMP_CWORD]}" "${COMP_WORDS[$((COMP_CWORD - 1))]}"
printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if shutil.which("bash") is None:
        pytest.skip("needs bash")
    path = tmp_path_factory.mktemp("completion") / "truearc.bash"
    with pytest.MonkeyPatch.context() as patch, path.open("w") as file:
        patch.setattr("sys.stdout", file)
        assert main(["completion", "bash"]) == 0
    return path


@pytest.mark.parametrize(("words", "completed"), [
    (["dis"], {"discover"}), (["paper", ""], {"fit", "synth", "train", "sweep"}),
    (["session", "re"], {"replay", "recover"}), (["paper", "fit", "--pi"], {"--picture"}),
    (["vision-c"], {"vision-calibrate"}), (["vision", "a.jpg", "--l"], {"--labels"}),
    (["vision-calibrate", "--b"], {"--board", "--bias-sigma"}),
    (["session", "convert", "s", "--to", ""], {"csv", "mcap", "parquet", "wpilog"}), (["prov"], {"prove"})])
def test_bash_completes_commands_options_and_choices(script: Path, words: list[str], completed: set[str]) -> None:
    done = subprocess.run(["bash", "-c", ASK, "ask", str(script), *words], capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) == completed


@pytest.mark.parametrize("shell", ["zsh", "tcsh"])
def test_other_shells_get_every_command(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    said = capsys.readouterr().out
    for command in list_commands():
        assert command.name.rpartition(" ")[2] in said
