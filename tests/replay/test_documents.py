"""Every command in the documents exists with its options, and the guide's are run, in order, in an empty folder."""

import re
import shlex
from dataclasses import fields
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from documents import effects_page, results_page
from log_writers import flight, quad_flight, write_data_set, write_tlog

import companion.cli
import models.cli
import replay.cli
from models.corner_law import ClosedForm
from models.effects import catalogue
from models.vehicle import Fan, Limits, Rangefinder, Rotor, Throttle, Vane, Vehicle

ROOT = Path(__file__).resolve().parents[2]
README = ROOT / "README.md"
MANUAL = sorted(path for path in (ROOT / "docs").glob("*.md") if path.name != "results.md")
DOCUMENTS = [
    README,
    *MANUAL,
    ROOT / "docs" / "results.md",
    *sorted((ROOT / "docs" / "lab").rglob("*.md")),
]
WORDS_OF_README = 700
FIGURE = re.compile(
    r"±|\d+ of \d+ (flights|right|seeds)|\[[+−-]?[\d.]+, [+−-]?[\d.]+\]|\d [mµ]s p\d\d|\*\*missed\*\*"
)
"""A measured figure: such stand in docs/results.md and in the notebook only."""
ON_THE_VEHICLE = "# on the vehicle"
BENCHMARKS = ROOT / "tests" / "benchmarks"
MEASURE = re.findall(r"^\| `([\w.]+)` \|", (BENCHMARKS / "README.md").read_text("utf-8"), re.M)
"""Commands that measure, by their tables."""
PARSERS = {
    "companion": companion.cli.parser,
    "replay": replay.cli.parser,
    "models": models.cli._parser,
}


def commands(document):
    """The lines of every sh block."""
    for block in re.findall(r"```sh\n(.*?)```", document.read_text(encoding="utf-8"), re.S):
        for line in block.replace("\\\n", " ").splitlines():
            if line.strip() and not line.strip().startswith("#"):
                yield line.strip()


ALL = [(document.name, line) for document in DOCUMENTS for line in commands(document)]
GUIDE = [line for name, line in ALL if name == "guide.md"]


def parts(line):
    """Programs and arguments of a line, without comments, variables and optional brackets."""
    text = re.sub(r"\s#.*$", "", line).replace("…", "").replace("[", "").replace("]", "")
    for part in text.split("&&"):
        words = [w for w in shlex.split(part) if not re.match(r"^[A-Z_0-9]+=", w)]
        if words:
            program = Path(words[0]).name
            if program.startswith("python") and words[1:2] == ["-m"]:
                program, words = words[2], words[2:]
            yield program, words[1:]


@pytest.mark.parametrize(("document", "line"), ALL, ids=[f"{d}: {c[:60]}" for d, c in ALL])
def test_every_documented_command_exists_with_its_options(document, line, capsys):
    for program, arguments in parts(line):
        if program in PARSERS:
            try:
                PARSERS[program]().parse_args(arguments)
            except SystemExit as stop:
                pytest.fail(f"{document}: {line}: {stop.code} {capsys.readouterr().err}")
        elif program.startswith("python") and arguments[:1] == ["tests/benchmarks"]:
            assert arguments[1] in MEASURE, f"{document}: {arguments[1]}"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder with what a reader of the guide has by then: recordings, and the data of a fan."""
    monkeypatch.chdir(tmp_path)
    write_tlog(tmp_path / "sim.tlog", flight(20.0))
    write_tlog(tmp_path / "hover.tlog", quad_flight(60.0))
    write_tlog(tmp_path / "flight.tlog", quad_flight(40.0, mass_kg=3.4, seed=2))
    (tmp_path / "logs").mkdir()
    write_tlog(tmp_path / "logs" / "monday.tlog", quad_flight(25.0, seed=3))
    data = ClosedForm().data_set()
    write_data_set(tmp_path / "fan.csv", data)
    return tmp_path


@pytest.mark.slow
def test_the_guide_runs_word_by_word(folder, capsys):
    """The flight of the built-in vehicle is cut to four seconds; what it would have recorded lies there already."""
    ran = 0
    for line in GUIDE:
        if ON_THE_VEHICLE in line:
            continue
        for program, arguments in parts(line):
            if program not in PARSERS:
                continue  # the environment and its packages: tests/benchmarks/documents/guide_fresh.py makes one
            if program == "companion":
                cut = [*arguments, "--duration", "4"]
                cut[cut.index("sim.tlog")] = "short.tlog"
                code = companion.cli.main(cut)
            else:
                code = {"replay": replay.cli.main, "models": models.cli.main}[program](arguments)
            assert code == 0, f"{line}: exit code {code}: {capsys.readouterr().err}"
            ran += 1
    assert ran >= 12
    for made in (
        "hover.csv",
        "my.toml",
        "report/report.html",
        "my-model/model.json",
        "season/report.html",
        "my-fan",
    ):
        assert (folder / made).exists(), made


def test_what_runs_in_the_guide_is_said_to_need_a_vehicle_only_where_it_does():
    for line in GUIDE:
        if "udp:" in line or "/dev/" in line:
            assert ON_THE_VEHICLE in line


def test_every_key_of_a_vehicle_file_is_explained():
    text = (ROOT / "docs" / "vehicle.md").read_text(encoding="utf-8")
    keys = {
        f.name for kind in (Rotor, Fan, Vane, Throttle, Rangefinder, Limits) for f in fields(kind)
    }
    keys |= {f.name for f in fields(Vehicle)} - {
        "fans",
        "vanes",
        "rangefinders",
        "throttle",
        "limits",
    }
    for key in sorted(keys):
        assert f"`{key}`" in text, key
    for table in ("[[fan]]", "[[vane]]", "[[rangefinder]]", "[throttle]", "[limits]"):
        assert f"`{table}`" in text


def read_parameters(path):
    """Names and values: ``NAME,VALUE`` of ArduPilot, or PX4's five columns, the name third."""
    lines = (line.split("#", 1)[0] for line in path.read_text(encoding="utf-8").splitlines())
    words = [re.split(r"[,\s]+", line.strip()) for line in lines if line.strip()]
    return {w[-3] if len(w) > 2 else w[0]: float(w[-2] if len(w) > 2 else w[1]) for w in words}


def test_parameter_files_load_and_say_what_the_companion_asks_for():
    ardupilot = read_parameters(ROOT / "docs" / "params" / "ardupilot.param")
    assert int(ardupilot["GUID_OPTIONS"]) & 8
    assert ardupilot["GUID_TIMEOUT"] <= 1.0
    assert ardupilot["RNGFND1_ORIENT"] == 25.0
    px4 = read_parameters(ROOT / "docs" / "params" / "px4.params")
    assert px4["SER_TEL2_BAUD"] == 921600.0
    assert px4["COM_OF_LOSS_T"] <= 1.0


def anchors(document):
    """Addresses of a document's headings, as GitHub makes them."""
    text = re.sub(r"```.*?```", "", document.read_text(encoding="utf-8"), flags=re.S)
    heads = re.findall(r"^#+ (.*)$", text, re.M)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("document", DOCUMENTS, ids=[str(d.relative_to(ROOT)) for d in DOCUMENTS])
def test_every_relative_link_leads_somewhere(document):
    text = re.sub(r"```.*?```", "", document.read_text(encoding="utf-8"), flags=re.S)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        file = document.parent / path if path else document
        assert file.exists(), f"{document.name}: {target}"
        if anchor and file.suffix == ".md":
            assert anchor in anchors(file), f"{document.name}: {target}"


def test_every_file_of_the_architecture_exists():
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    package = None
    for line in text.splitlines():
        head = re.match(r"(?:## |In )`(models|companion(?:/sim)?|replay)/`", line)
        package = head[1] if head else None if line.startswith("## ") else package
        for name in (
            re.findall(r"`([\w/.]+)`", line.split("|")[1])
            if package and line.startswith("| `")
            else ()
        ):
            path = ROOT / package / name
            assert path.exists() or path.with_suffix(".py").exists(), f"{package}/{name}"
    for path in re.findall(r"`((?:models|companion|replay)/[\w/]+\.py)`", text):
        assert (ROOT / path).exists(), path


def test_the_readme_is_short_and_begins_with_the_two_commands_of_a_fresh_machine():
    text = README.read_text(encoding="utf-8")
    assert len(text.split()) <= WORDS_OF_README
    first, second = re.findall(r"```sh\n(.*?)```", text, re.S)[:2]
    assert first.startswith("python3 -m venv .venv &&")
    assert first.strip().endswith("companion --connect sim:corner --compare")
    assert second.startswith("python3 -m venv .venv-test &&")
    assert second.strip().endswith("python -m pytest")


def test_the_readme_installs_what_reads_logs_before_it_is_used():
    lines = list(commands(README))
    first = next(k for k, line in enumerate(lines) if line.startswith("replay "))
    before = " ".join(lines[:first])
    assert ". .venv/bin/activate" in before
    assert '".[serve]"' in before


def test_results_page_and_table_of_the_readme_are_what_the_json_files_give():
    found = results_page.results()
    assert results_page.PAGE.read_text(encoding="utf-8") == results_page.page(found), (
        "run results_page.py"
    )
    text = README.read_text(encoding="utf-8")
    assert text == results_page.readme(text, found), "run results_page.py"
    assert sum(f.readme is not None for r in found for f in r.figures) == 6


def test_the_page_of_effects_is_what_the_catalogue_says_and_every_effect_has_a_picture():
    effects = list(catalogue())
    assert effects_page.PAGE.read_text(encoding="utf-8") == effects_page.page(effects), (
        "run effects_page.py"
    )
    made_up = effects_page.flight()
    for effect in effects:
        _, _, x, y = effects_page.curve(effect, made_up)
        assert len(x) == len(y) > 100
        assert np.abs(y).max() > 0.0, effect.name


def test_every_command_that_measures_stands_in_their_table():
    commands = {
        ".".join(path.relative_to(BENCHMARKS).with_suffix("").parts).removesuffix(".__main__")
        for path in BENCHMARKS.rglob("*.py")
        if "\nif __name__ == " in path.read_text(encoding="utf-8")
    }
    assert sorted(MEASURE) == sorted(commands)


@pytest.mark.parametrize("name", MEASURE)
def test_every_command_that_measures_says_what_its_options_are(name, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", [name, "--help"])
    package = BENCHMARKS.joinpath(name, "__main__.py").exists()
    command = import_module(f"{name}.__main__" if package else name)
    with pytest.raises(SystemExit) as stop:
        command.main()
    assert stop.value.code == 0
    assert "--help" in capsys.readouterr().out


def test_a_result_names_what_is_wrong_in_its_file(tmp_path):
    path = tmp_path / "x.json"
    path.write_text('{"title": "x", "figures": [{"what": "a", "value": "1"}]}', encoding="utf-8")
    with pytest.raises(ValueError, match=r"x\.json.*command"):
        results_page.load(path)


@pytest.mark.parametrize("document", [README, *MANUAL], ids=lambda d: d.name)
def test_figures_stand_on_the_page_of_results_only(document):
    text = document.read_text(encoding="utf-8")
    if document == README:
        text = text.split(results_page.START)[0] + text.split(results_page.END)[1]
    for line in re.sub(r"```.*?```", "", text, flags=re.S).splitlines():
        assert not FIGURE.search(line), f"{document.name}: {line}"
