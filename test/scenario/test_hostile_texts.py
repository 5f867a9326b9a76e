"""Scenario texts of anybody: each is one line with its place, before anything is built from it."""

import os
import time

import pytest

from cacc_platoon.errors import MAX_LINE, UserError, one_line
from cacc_platoon.model.leader import MAX_ROWS
from cacc_platoon.scenario.file import format_scenario, load_scenario, parse_scenario, scenario_name
from cacc_platoon.scenario.ros_sections import _matches
from cacc_platoon.scenario.scenario import Scenario

HEAD = "/**:\n  ros__parameters:\n"
PATIENCE = 20.0  # s of CPU time


def aliases(template: str, levels: int = 40) -> str:
    lines = [f"    a{i}: &a{i} {template.format(i - 1)}\n" for i in range(1, levels)]
    return HEAD + "    a0: &a0 {x: 1}\n" + "".join(lines)


def refusal(text: str) -> str:
    begun = time.process_time()
    with pytest.raises(UserError) as error:
        parse_scenario(text, "my.yaml")
    assert time.process_time() - begun < PATIENCE
    line = str(error.value)
    assert line.isprintable()
    assert len(line) <= MAX_LINE + len(" ... ")
    return line


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f"{HEAD}    a: &a [*a]\n", "line 3 cannot be read as YAML: alias a stands inside"),
        (
            "/**: &a\n  ros__parameters: *a\n",
            "line 2 cannot be read as YAML: alias a stands inside",
        ),
        (f"{HEAD}    a: {'[' * 5000}\n", "line 3 cannot be read as YAML: nested deeper than 50"),
        (f"{HEAD}    a: {'{a: ' * 5000}\n", "line 3 cannot be read as YAML: nested deeper than 50"),
        (f"{HEAD}    run.seed: !!int abc\n", "line 3 cannot be read as YAML: 'abc' is no value of"),
        (f"{HEAD}    run.step: !!float\n", "line 3 cannot be read as YAML: '' is no value of type"),
        (f"{HEAD}    run.spawn: !!bool x\n", "line 3 cannot be read as YAML: 'x' is no value of"),
        (f"{HEAD}    run.seed: 2020-13-45\n", "line 3 cannot be read as YAML: '2020-13-45' is no"),
        (f"{HEAD}    run.seed: !!int 0b2\n", "line 3 cannot be read as YAML: '0b2' is no value"),
        (f'{HEAD}    a: "\\U99999999"\n', "line 3 cannot be read as YAML: an escape in the text"),
        (f"{HEAD}    run.seed: {'9' * 309}\n", "line 3 cannot be read as YAML: a number of 309"),
        (f"{HEAD}    run.seed: {'9' * 5000}\n", "line 3 cannot be read as YAML: a number of 5000"),
        (f"{HEAD}    a: b\0c\n", "line 3 cannot be read as YAML: special characters"),
        (f'{HEAD}    leader.file: "a\\0b"\n', "leader.file = 'a\\x00b' must be at most 1000"),
        (f"{HEAD}    leader.file: {'x' * 5000}\n", "must be at most 1000 characters that can be"),
        (aliases("{{b: *a{0}, c: *a{0}}}"), "cannot be read as YAML: more than 100000 keys"),
        (aliases("[*a{0}, *a{0}]"), "cannot be read as YAML: more than 100000 keys and values"),
        (aliases("{{<<: [*a{0}, *a{0}]}}"), "cannot be read as YAML: more than 100000 keys"),
        (f"{HEAD}    # {'x' * 5_000_000}\n", "cannot be read as YAML: is larger than 4 MiB"),
        (f"{HEAD}    a: [{'1,' * 200_000}]\n", "line 3 cannot be read as YAML: more than 100000"),
        (f'{HEAD}    "\\e[31m\\nx": 1\n', "unknown key \\x1b[31m x, it would be ignored"),
        (f"{HEAD}    ? {'k' * 100_000}\n    : 1\n", "kkk ... kkk"),
        (f"# cacc_platoon scenario, format {'9' * 5000}\n{HEAD}", "format = '999"),
    ],
)
def test_a_hostile_text_is_one_line(text, words):
    assert words in refusal(text)


@pytest.mark.parametrize(
    "setting",
    ["run.duration=1e308", "v2v.rho=1e308", "v2v.rho=1e200", "controller.time_headway=1e-320"],
)
def test_numbers_that_nothing_can_be_computed_with(setting):
    with pytest.raises(UserError, match=r"must be|is closer to 0"):
        parse_scenario(HEAD.rstrip() + " {}\n", "my.yaml", settings=[setting])


@pytest.mark.parametrize("value", [10**400, -(10**400), 10**5000], ids=["large", "low", "endless"])
def test_whole_numbers_beyond_all_floats(value):
    with pytest.raises(UserError, match="must be finite"):
        Scenario.from_values({"run.duration": value})


def test_aliases_that_are_used_honestly_are_read():
    text = HEAD + "    run: &run {step: 0.02}\n/platoon/**:\n  ros__parameters: {run: *run}\n"
    assert parse_scenario(text, "my.yaml").run.step == 0.02


def test_a_pipe_is_refused_and_nobody_waits_for_it(tmp_path):
    os.mkfifo(tmp_path / "pipe.yaml")
    with pytest.raises(UserError, match="cannot be read: is a pipe or a device"):
        load_scenario(tmp_path / "pipe.yaml")


def test_many_wildcards_and_a_deep_namespace_are_matched_at_once():
    begun = time.process_time()
    assert not _matches("/**" * 30 + "/x", "/a" * 70)
    assert _matches("/**" * 30 + "/*", "/a" * 70)
    assert time.process_time() - begun < 1.0


@pytest.mark.slow
def test_a_large_table_of_speeds_makes_a_scenario_that_can_be_read(tmp_path):
    rows = "".join(f"{k / 7!r},{25 + k / 3e6!r}\n" for k in range(MAX_ROWS))
    (tmp_path / "speeds.csv").write_text("".join(rows.splitlines(keepends=True)[: MAX_ROWS // 4]))
    text = HEAD + "    leader: {profile: csv, file: speeds.csv}\n"
    scenario = parse_scenario(text, "my.yaml", tmp_path)
    again = parse_scenario(format_scenario(scenario), "again").leader
    assert (again.times, again.speeds) == (scenario.leader.times, scenario.leader.speeds)
    (tmp_path / "speeds.csv").write_text(rows + "1e9,25\n")
    with pytest.raises(UserError, match=f"more than the {MAX_ROWS}"):
        parse_scenario(text, "my.yaml", tmp_path)


def test_the_name_of_a_scenario_can_be_shown_and_be_a_folder():
    assert scenario_name("# Scenario ../\x1b[2Jx\n") == "..__x1b[2Jx".replace("__", "_\\")
    assert len(scenario_name(f"# Scenario {'x' * 5000}\n") or "") < 120


def test_a_line_keeps_both_ends_of_a_long_text():
    line = one_line("begin " + "x" * 10**6 + " end")
    assert line.startswith("begin ")
    assert line.endswith(" end")
    assert len(line) <= MAX_LINE + len(" ... ")
