"""Shell completion, as bash itself completes."""

import shutil
import subprocess
from pathlib import Path

import pytest

from truearc.cli.main import list_commands, main

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
    (["session", "convert", "s", "--to", ""], {"csv", "mcap", "parquet", "wpilog"}), (["prov"], {"prove"}),
])
def test_bash_completes_commands_options_and_choices(script: Path, words: list[str], completed: set[str]) -> None:
    done = subprocess.run(["bash", "-c", ASK, "ask", str(script), *words], capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) == completed


@pytest.mark.parametrize("shell", ["zsh", "tcsh"])
def test_other_shells_get_every_command(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    said = capsys.readouterr().out
    for command in list_commands():
        assert command.name.rpartition(" ")[2] in said
