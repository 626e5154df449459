"""Every pair of options either does something together or is refused by name, with one line."""

from __future__ import annotations

import ast
import inspect
from itertools import combinations

import pytest

from companion import cli

VALUES = {
    "--baud": "57600", "--vehicle": "v.toml", "--model": "none", "--setpoint": "udpin:127.0.0.1:5",
    "--carrier": "acceleration", "--record": "f.tlog", "--page": ":8080", "--survey": "0.3:1",
    "--adapt": "full", "--duration": "5", "--signing-key": "key", "--target-system": "3",
    "--seed": "4", "--json": "-", "--plot": "p.svg",
}  # fmt: skip
FLAGS = ("--check", "--dry-run", "--no-offsets", "--compare", "--quiet", "--vision")
OPTIONS = (*VALUES, *FLAGS)
LINKS = ("sim:corner", "udp:127.0.0.1:5", "/dev/ttyAMA0", "f.tlog")
NEEDED = {"--survey": "--record", "--plot": "--compare"}
"""What an option needs beside it: given along, so that the pair is looked at and not that."""
AT_ODDS = {
    ("--dry-run", "--survey"), ("--setpoint", "--carrier"), ("--setpoint", "--survey"),
}  # fmt: skip
"""Pairs that the flight program reads and of which one does nothing: nothing is sent, or another holds."""
OTHER_LINKS = {(a, b) for a in ("--baud", "--signing-key") for b in ("--seed", "--vision")}
"""A real link's option and the built-in vehicle's: each is refused by name of the other's link."""


def read_by(command: str) -> set[str]:
    """Options that a function of the command line reads, by its source and that of those that it hands them to."""
    body = ast.parse(inspect.getsource(cli)).body
    functions = {node.name: node for node in body if isinstance(node, ast.FunctionDef)}
    found, left, seen = set(), [command], set()
    while left:
        name = left.pop()
        seen.add(name)
        for node in ast.walk(functions[name]):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "a":
                found.add(f"--{node.attr.replace('_', '-')}")
            called = node.func.id if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) else ""
            if called in functions and called not in seen:
                left.append(called)
    return found


READ = {"--compare": read_by("_compare"), "--check": read_by("_preflight"), "": read_by("_fly")}


def given(link: str, *options: str) -> list[str]:
    needed = [NEEDED[option] for option in options if option in NEEDED]
    out = ["--connect", link]
    for option in dict.fromkeys((*options, *needed)):
        out += [option] if option in FLAGS else [option, VALUES[option]]
    return out


def refusals(arguments: list[str]) -> list[str]:
    return list(cli.without_effect(cli.parser().parse_args(arguments)))


def test_every_option_is_looked_at():
    known = {o for action in cli.parser()._actions for o in action.option_strings if o.startswith("--")}
    assert known == {*OPTIONS, "--connect", "--help", "--version"}


@pytest.mark.parametrize("pair", list(combinations(OPTIONS, 2)), ids=" ".join)
def test_a_pair_does_something_or_is_refused_by_name(pair):
    command = next((c for c in ("--check", "--compare") if c in given("", *pair)), "")
    useful = set(pair) - {command} <= READ[command] and not (AT_ODDS | OTHER_LINKS) & {pair, pair[::-1]}
    refused = [refusals(given(link, *pair)) for link in LINKS]
    assert any(not lines for lines in refused) is useful, refused
    if not useful and not OTHER_LINKS & {pair, pair[::-1]}:
        said = " ".join(line for lines in refused for line in lines if any(option in line for option in pair))
        assert all(option in said or NEEDED.get(option, option) in said for option in pair)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--connect", "sim:", "--baud", "57600"], ["--baud", "--connect /dev/"]),
        (["--connect", "udp:127.0.0.1:5", "--seed", "3"], ["--seed", "--connect sim:"]),
        (["--connect", "udp:127.0.0.1:5", "--compare"], ["--compare", "--connect sim:"]),
        (["--connect", "sim:", "--signing-key", "key"], ["--signing-key", "--connect sim:"]),
        (["--connect", "sim:", "--check", "f.tlog"], ["--connect", "--check FILE.tlog"]),
        (["--check", "f.tlog", "--duration", "3"], ["--duration", "--check FILE.tlog"]),
        (["--connect", "sim:", "--survey", "0.3:1"], ["--survey", "--record"]),
        (["--connect", "sim:", "--plot", "p.svg"], ["--plot", "--compare"]),
        (["--connect", "sim:", "--compare", "--no-offsets"], ["--no-offsets", "--compare"]),
    ],
)
def test_what_does_nothing_is_one_line_and_exit_code_2(arguments, named, capsys):
    assert cli.main(arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    for name in named:
        assert name in line
