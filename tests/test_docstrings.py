"""What docs/stability.md lists says in its docstring what it takes, gives and raises, and shows it by an example that
runs."""

from __future__ import annotations

import ast
import doctest
import inspect
import os
import re
import runpy
import textwrap
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from log_writers import QUAD_MASS_KG, quad_flight, write_tlog

import models
import replay
from companion.vehicles import QUAD
from models.common.errors import (
    ConfigError,
    LogError,
    ModelError,
    NotFittedError,
    UserError,
)
from models.corner_law import ClosedForm
from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import load_vehicle
from replay import Diagnosis, FlightModel, Record
from replay.logs.plugins import LogReader

PAGE = Path(__file__).resolve().parents[1] / "docs" / "stability.md"
OWNERS = {"models": FanSurrogate, "replay": Record}
"""Whose members a row lists after its semicolon."""
HEAVIER_KG = 0.6


def listed() -> dict[str, Any]:
    """Every name of the page, and what it stands for."""
    out: dict[str, Any] = {"LogReader": LogReader}
    for package, cell in re.findall(r"^\| `([a-z_.]+)` \| (.*) \|$", PAGE.read_text(), re.M):
        names, _, members = cell.partition(";")
        for name in re.findall(r"`(\w+)`", names):
            out[f"{package}.{name}"] = getattr(import_module(package), name)
        for name in re.findall(r"`(\w+)`", members):
            owner = OWNERS[package]
            out[f"{owner.__name__}.{name}"] = inspect.getattr_static(owner, name, None)
    return out


PUBLIC = listed()
CLASSES = {name: thing for name, thing in PUBLIC.items() if inspect.isclass(thing)}
RECORDS = {
    name: of
    for name, of in CLASSES.items()
    if not issubclass(of, Exception) and of is not LogReader
}
EXAMPLES = [
    name
    for name, thing in PUBLIC.items()
    if callable(thing) and UserError not in getattr(thing, "__bases__", ())
]


def calls() -> dict[str, Any]:
    """Functions, and the methods of classes."""
    out = {name: thing for name, thing in PUBLIC.items() if inspect.isfunction(thing)}
    for name, of in CLASSES.items():
        for method, thing in vars(of).items():
            if inspect.isfunction(thing) and not method.startswith("_"):
                out[f"{name}.{method}"] = thing
    return {**out, "LogReader.__call__": LogReader.__call__}


CALLS = calls()


def bad_log(call: Callable[[str], object]) -> Callable[[], object]:
    return lambda: call("no_such_flight.tlog")


def vehicle() -> Any:
    return load_vehicle(QUAD)


def fitted() -> Diagnosis:
    """As if it were fitted: what is asked of it next fails before it looks."""
    diagnosis = Diagnosis()
    diagnosis.answer_ = diagnosis.model_ = None  # type: ignore[assignment]
    diagnosis.vehicle_ = vehicle()
    return diagnosis


RAISED: dict[str, dict[type[UserError], Callable[[], object]]] = {
    "models.load": {ModelError: lambda: models.load("no-such-model")},
    "models.save_model": {ModelError: lambda: models.save_model("file/x", models.load())},
    "models.train": {ModelError: lambda: models.train("file", method="polynomial")},
    "models.vehicle.load_vehicle": {ConfigError: lambda: load_vehicle("file")},
    "replay.load": {
        LogError: bad_log(replay.load),
        ConfigError: lambda: replay.load("flight.tlog", settings={"battery": "none"}),
    },
    "replay.build_record": {
        LogError: lambda: replay.build_record(short_flight(), vehicle(), None),
        ConfigError: lambda: replay.build_record(short_flight(), "my.toml", None),  # type: ignore[arg-type]
    },
    "replay.diagnose": {
        LogError: bad_log(lambda log: replay.diagnose(log, mass_kg=3.0)),
        ConfigError: lambda: replay.diagnose("flight.tlog", "file"),
        ModelError: lambda: replay.diagnose("flight.tlog", QUAD, "no-such-model"),
    },
    "replay.rollout": {
        ConfigError: lambda: replay.rollout(FlightModel(vehicle()), np.zeros(13), [[[0.0] * 4]])
    },
    "replay.Diagnosis.fit": {
        LogError: bad_log(Diagnosis(QUAD).fit),
        ConfigError: lambda: Diagnosis("file").fit("flight.tlog"),
        ModelError: lambda: Diagnosis(QUAD, "no-such-model").fit("flight.tlog"),
    },
    "replay.Diagnosis.predict": {
        NotFittedError: bad_log(Diagnosis().predict),
        LogError: bad_log(fitted().predict),
        ConfigError: lambda: fitted().predict("flight.tlog", horizon_s=0.0),
    },
    "replay.Diagnosis.score": {
        NotFittedError: bad_log(Diagnosis().score),
        LogError: bad_log(fitted().score),
    },
    "replay.Diagnosis.plot": {NotFittedError: Diagnosis().plot},
    "replay.Diagnosis.save": {
        NotFittedError: lambda: Diagnosis().save("x"),
        ModelError: lambda: saved_into_a_file(),
    },
    "replay.FlightLog.beam": {ConfigError: lambda: short_flight().beam("donw")},
    "LogReader.__call__": {LogError: lambda: own_reader()(Path("file"))},
}
"""What a call raises, by a call that raises it."""


def short_flight() -> replay.FlightLog:
    (log,) = replay.load("flight.tlog")
    return log.between(log.start_s, log.start_s + 1.0)


def own_reader() -> LogReader:
    read: LogReader = runpy.run_path(str(PAGE.parent / "examples" / "own_log_format.py"))["read"]
    return read


def saved_into_a_file() -> object:
    diagnosis = fitted()
    diagnosis.model_ = models.load()
    return diagnosis.save("file/x")


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with what the examples name: two flights, a vehicle file, data of a fan."""
    folder = tmp_path_factory.mktemp("examples")
    for seed, name in enumerate(("flight", "friday")):
        flight = quad_flight(40.0, mass_kg=QUAD_MASS_KG + HEAVIER_KG, seed=seed)
        write_tlog(folder / f"{name}.tlog", flight)
    (folder / "my.toml").write_text(QUAD.read_text())
    (folder / "file").write_text("this is none")
    data = ClosedForm().data_set()
    rows = ["h_m,d_m,rpm,Fx_N,Fy_N,Fz_N,Mx_Nm,My_Nm,Mz_Nm"]
    for h, d, rpm, wrench in zip(data.h, data.d, data.rpm, data.wrench, strict=True):
        rows.append(",".join(f"{v:.9g}" for v in (h, d, rpm, *wrench)))
    (folder / "fan.csv").write_text("\n".join(rows) + "\n")
    before = Path.cwd()
    os.chdir(folder)
    yield folder
    os.chdir(before)


def sections(thing: object) -> dict[str, str]:
    """Sections of a docstring as numpydoc has them: heading to text."""
    parts = re.split(r"^([A-Z]\w+)\n-{3,}\n", inspect.getdoc(thing) or "", flags=re.M)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def names_in(section: str) -> set[str]:
    """What a section describes: the names that begin its unindented lines."""
    out: set[str] = set()
    for line in re.findall(r"^\S.*$", section, re.M):
        names, _, _ = line.partition(" : ")
        out.update(names.strip("*").split(", "))
    return out


def described_fields(of: type) -> set[str]:
    """Fields of a record that have a docstring of their own."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(of))).body
    assert isinstance(tree, ast.ClassDef)
    out = set()
    for field, text in zip(tree.body, tree.body[1:], strict=False):
        said = isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and said:
            out.add(field.target.id)
    return out


def test_the_page_lists_what_the_packages_export() -> None:
    for name in ("models", "companion", "replay"):
        package = import_module(name)
        assert {f"{name}.{one}" for one in package.__all__} <= set(PUBLIC)


@pytest.mark.parametrize("name", PUBLIC)
def test_it_begins_with_a_line_of_its_own(name: str) -> None:
    of = PUBLIC[name]
    if callable(of) or isinstance(of, property):
        first = (inspect.getdoc(of) or "").split("\n")[0]
        assert first.endswith((".", ":")), f"{name}: {first!r}"
    else:
        owner, _, field = name.partition(".")
        (kind,) = (one for one in OWNERS.values() if one.__name__ == owner)
        known = described_fields(kind) | names_in(sections(kind).get("Parameters", ""))
        assert field in known, f"{name} is not described"


@pytest.mark.parametrize("name", CALLS)
def test_it_says_what_it_takes_and_gives(name: str) -> None:
    of = CALLS[name]
    said = sections(of)
    signature = inspect.signature(of)
    takes = set(signature.parameters) - {"self"}
    missing = takes - names_in(said.get("Parameters", ""))
    assert not missing, f"{name}: Parameters lacks {sorted(missing)}"
    if signature.return_annotation != "None":
        assert said.get("Returns") or said.get("Yields"), f"{name} has no Returns"


@pytest.mark.parametrize("name", RECORDS)
def test_it_says_what_it_holds(name: str) -> None:
    of = RECORDS[name]
    said = sections(of)
    missing = set(inspect.signature(of).parameters) - described_fields(of)
    missing -= names_in(said.get("Parameters", ""))
    assert not missing, f"{name}: {sorted(missing)} are not described"


@pytest.mark.parametrize("name", sorted({*CALLS, *RAISED}))
def test_it_raises_what_it_says(name: str, place: Path) -> None:
    of = CALLS.get(name) or PUBLIC[name]
    said = names_in(sections(of).get("Raises", ""))
    raised = RAISED.get(name, {})
    assert said == {error.__name__ for error in raised}, f"Raises of {name}"
    if "raise " in inspect.getsource(of):
        assert raised, f"{name} has no Raises"
    for error, call in raised.items():
        with pytest.raises(error):
            call()


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_its_example_runs(name: str, place: Path) -> None:
    of = PUBLIC[name]
    text = sections(of).get("Examples", "")
    example = doctest.DocTestParser().get_doctest(text, {}, name, None, None)
    assert example.examples, f"{name} has no Examples"
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    wrong: list[str] = []
    assert runner.run(example, out=wrong.append).failed == 0, "".join(wrong)
