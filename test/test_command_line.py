"""The command's entrance: what it imports, and how an early Ctrl-C ends it."""

import importlib
import subprocess
import sys

import pytest

from cacc_platoon.cli import VERBS, main


def test_ctrl_c_while_a_verb_is_imported_says_one_line(monkeypatch, capsys):
    def interrupted(name):
        raise KeyboardInterrupt

    monkeypatch.setattr(importlib, "import_module", interrupted)
    for arguments in (["run", "scenario.yaml"], ["--help"]):
        try:
            code = main(arguments)
        except KeyboardInterrupt:  # would end pytest itself
            code = None
        assert code == 130
        assert capsys.readouterr() == ("", "platoon: interrupted\n")


@pytest.mark.parametrize("verb", VERBS)
def test_a_verb_imports_no_other(verb):
    shared = {"simulate": {"run"}, "paper": {"run", "simulate"}}.get(verb, set())  # built on these
    program = (
        "import sys\nfrom cacc_platoon.cli import VERBS, main\n"
        "try: main(sys.argv[1:])\nexcept SystemExit as end: assert end.code == 0\n"
        "print([v for v in VERBS if f'cacc_platoon.cli.{v}' in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, verb, "--help"], capture_output=True, text=True
    )
    assert done.stdout.startswith(f"usage: platoon {verb} ")
    imported = [name for name in VERBS if name == verb or name in shared]
    assert done.stderr.splitlines() == [str(imported)]


def test_help_shows_every_verb_with_its_summary(capsys):
    with pytest.raises(SystemExit) as end:
        main(["--help"])
    assert end.value.code == 0
    text = " ".join(capsys.readouterr().out.split())
    for verb in VERBS:
        module = importlib.import_module(f"cacc_platoon.cli.{verb}")
        assert f"{verb} {str(module.__doc__).partition(chr(10))[0]}" in text


@pytest.mark.parametrize("arguments", [[], ["rnu"], ["--wrong", "doctor"], ["run", "a", "--wrong"]])
def test_a_wrong_command_line_is_refused_with_the_usage(arguments, capsys):
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2
    error = capsys.readouterr().err
    assert error.startswith("usage: platoon [-h] [--version] VERB ...\n")
    if arguments == ["rnu"]:
        assert all(f"'{verb}'" in error for verb in VERBS)
