"""``replay`` as a command: reports, exit codes, one line for every bad input."""

import json
import math
import os
import resource
import subprocess
import sys

import pytest
from log_writers import bin_flight, flight, frame, heartbeat, ulg_flight, write_tlog
from patience import HANG_S

from companion.mavlink.wire_frames import cut
from companion.vehicles import QUAD, TANDEM
from models.common.extras import how_to_install
from replay.cli import main
from replay.logs.tlog import read_tlog


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "flight.tlog"
    write_tlog(path, flight(4.0))
    return path


def test_report_for_people(log, capsys):
    assert main(["run", str(log)]) == 0
    out = capsys.readouterr()
    assert "flight.tlog: " in out.out
    assert "compensated" in out.out
    assert out.err == ""


def test_report_as_json_to_stdout_and_nothing_else(log, capsys):
    assert main(["run", str(log), "--json", "-"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["system"] == 1
    assert report["samples"] == sum(report["samples_by_kind"].values())
    assert 190 <= report["decisions"] <= 200
    assert report["duration_s"] == pytest.approx(3.98, abs=0.05)
    assert 0.0 <= report["share_compensated"] <= 1.0
    assert set(report["refusals_s"]) >= {"no_heartbeat"} or report["refusals_s"]
    assert report["h_m"]["min"] <= report["h_m"]["mean"] <= report["h_m"]["max"]
    assert all(math.isfinite(v) for v in report["trust"].values())
    assert report["boots"] == 1


def test_report_as_json_to_a_file(log, tmp_path, capsys):
    target = tmp_path / "report.json"
    assert main(["run", str(log), "--json", str(target), "--quiet"]) == 0
    assert capsys.readouterr().out == ""
    assert json.loads(target.read_text())["log"] == str(log)
    assert main(["run", str(log), "--json", str(tmp_path / "no" / "where.json")]) == 2
    assert "--json" in capsys.readouterr().err


def test_assumed_parameter_lets_offsets_through(tmp_path, capsys):
    path = tmp_path / "silent.tlog"
    write_tlog(path, [m for m in flight(4.0) if cut(m[1], 0).id != 22])
    main(["run", str(path), "--json", "-"])
    assert json.loads(capsys.readouterr().out)["compensated_s"] == 0.0
    main(["run", str(path), "--json", "-", "--param", "GUID_OPTIONS=8"])
    assert json.loads(capsys.readouterr().out)["commands"] > 0


def test_bin_and_ulg_run_and_say_what_they_lack(tmp_path, capsys):
    for name, content in (("a.BIN", bin_flight()), ("b.ulg", ulg_flight())):
        (tmp_path / name).write_bytes(content)
        assert main(["run", str(tmp_path / name), "--vehicle", str(TANDEM), "--json", "-"]) == 0
        report = json.loads(capsys.readouterr().out)
        assert report["decisions"] > 100
    assert "rotor speeds" in " ".join(report["notes"])


def test_two_vehicles_and_the_choice_between_them(tmp_path, capsys):
    path = tmp_path / "two.tlog"
    write_tlog(path, sorted([*flight(2.0, system=3), *flight(1.0, system=8)]))
    assert main(["run", str(path)]) == 0
    assert "system 3 chosen" in capsys.readouterr().out
    assert main(["run", str(path), "--target-system", "8", "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["system"] == 8


def bad_inputs(folder):
    good = folder / "good.tlog"
    write_tlog(good, flight(1.0))
    (folder / "empty.tlog").write_bytes(b"")
    (folder / "noise.tlog").write_bytes(bytes(range(256)) * 100)
    (folder / "noise.bin").write_bytes(bytes(range(256)) * 100)
    (folder / "noise.ulg").write_bytes(bytes(range(256)) * 100)
    (folder / "flight.csv").write_text("a,b\n")
    (folder / "folder.tlog").mkdir()
    (folder / "typo.toml").write_text('name = "x"\nmas_kg = 3\n')
    write_tlog(folder / "beats.tlog", [(10**15 + k, frame(heartbeat())) for k in range(5)])
    write_tlog(
        folder / "station.tlog",
        [(10**15 + k, frame(heartbeat(autopilot=8), 255, 190)) for k in range(5)],
    )
    run = "run"
    return [
        ([run, "missing.tlog"], 3, "missing.tlog"),
        ([run, "empty.tlog"], 3, "is empty"),
        ([run, "noise.tlog"], 3, "no MAVLink frame"),
        ([run, "noise.bin"], 3, "dataflash"),
        ([run, "noise.ulg"], 3, "PX4 log"),
        ([run, "flight.csv"], 3, "known:"),
        ([run, "folder.tlog"], 3, "holds no log"),
        ([run, "beats.tlog"], 3, "ATTITUDE"),
        ([run, "station.tlog"], 3, "no vehicle"),
        ([run, "good.tlog", "--target-system", "9"], 3, "no vehicle with system id 9"),
        ([run, "good.tlog", "--target-system", "900"], 2, "--target-system"),
        ([run, "good.tlog", "--vehicle", "typo.toml"], 2, "typo.toml"),
        ([run, "good.tlog", "--vehicle", "none.toml"], 2, "none.toml"),
        ([run, "good.tlog", "--model", "no-model"], 2, "no-model"),
        ([run, "good.tlog", "--param", "GUID_OPTIONS"], 2, "--param"),
        ([run, "good.tlog", "--param", "A=nan"], 2, "--param"),
    ]


def test_every_bad_input_is_one_line_and_its_exit_code(tmp_path, monkeypatch, capsys):
    cases = bad_inputs(tmp_path)
    monkeypatch.chdir(tmp_path)
    for arguments, code, words in cases:
        assert main(arguments) == code, arguments
        out = capsys.readouterr()
        assert out.out == ""
        assert out.err.count("\n") == 1, out.err
        assert words in out.err
        assert out.err.startswith("replay: ")


@pytest.mark.parametrize(
    "arguments", [[], ["fly"], ["run"], ["run", "a.tlog", "--target-system", "x"]]
)
def test_bad_arguments_exit_with_2(arguments, capsys):
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.startswith("replay")
    assert "--help" in line


def test_an_interrupt_exits_with_130(log, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("replay.rerun.report.run", interrupted)
    assert main(["run", str(log)]) == 130


@pytest.mark.parametrize("command", [["--help"], ["run", "--help"]])
def test_help_is_quick_and_light(command):
    code = (
        "import sys, runpy\nsys.argv = ['replay', *sys.argv[1:]]\n"
        "try:\n    runpy.run_module('replay', run_name='__main__')\nexcept SystemExit as e:\n"
        "    heavy = {'torch', 'scipy', 'pymavlink', 'matplotlib', 'tqdm'} & set(sys.modules)\n"
        "    sys.exit(f'imports {heavy}' if heavy else e.code)"
    )
    times = []
    for _ in range(3):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(
            [sys.executable, "-c", code, *command], capture_output=True, text=True, timeout=HANG_S
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        # Processor time: a busy machine stretches the clock on the wall.
        times.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
        assert done.returncode == 0, done.stderr
        assert "exit codes" in done.stdout
    assert min(times) < 0.5


def blas_threads(script, *arguments, **environment):
    """Most threads of any linear algebra library at the end of a script."""
    code = (
        f"import sys\n{script}\n"
        "import scipy.linalg\n"
        "from threadpoolctl import threadpool_info\n"
        "print(max(found['num_threads'] for found in threadpool_info()))"
    )
    inherited = {name: value for name, value in os.environ.items() if "NUM_THREADS" not in name}
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        env=inherited | environment,
        capture_output=True,
        text=True,
        timeout=HANG_S,
        check=True,
    )
    return int(done.stdout.splitlines()[-1])


@pytest.mark.skipif(os.cpu_count() == 1, reason="one core has no second thread")
def test_a_command_keeps_linear_algebra_to_one_thread_unless_told_otherwise(log):
    run = "from replay.cli import main\nmain(['run', sys.argv[1], '--quiet'])"
    assert blas_threads("", log) > 1
    assert blas_threads(run, log) == 1
    assert blas_threads(run, log, OMP_NUM_THREADS="2") == 2


def recorded(shared_data, suffixes):
    return sorted(p for p in shared_data.glob("*/*") if p.suffix.lower() in suffixes)


@pytest.mark.slow
def test_the_start_of_every_recorded_flight_runs(shared_data, tmp_path, capsys):
    """The first 60 kB of each, cut in the middle of a frame."""
    paths = recorded(shared_data, {".tlog"})
    assert len(paths) >= 20
    for path in paths:
        cut = tmp_path / path.name
        cut.write_bytes(path.read_bytes()[:60_000])
        cut.write_bytes(path.read_bytes()[: int(read_tlog(cut).start[-1]) + 5])
        assert main(["run", str(cut), "--vehicle", "tandem", "--json", "-"]) == 0, path
        report = json.loads(capsys.readouterr().out)
        assert report["decisions"] > 5, path
        assert any("cut off" in note for note in report["notes"])


@pytest.mark.parametrize("folder", [False, True])
def test_a_package_that_is_not_installed_is_one_line_that_says_what_to_install(
    folder, log, capsys, monkeypatch
):
    def missing(*_: object, **__: object) -> None:
        raise ModuleNotFoundError("No module named 'scipy'", name="scipy.linalg")

    if folder:
        monkeypatch.setattr("replay.fleet.folder.import_module", missing)
    else:
        monkeypatch.setattr("replay.diagnosis.diagnose.diagnose", missing)
    out = ["--out", str(log.parent / "out")] if folder else []
    assert main(["diagnose", str(log.parent if folder else log), "--vehicle", str(QUAD), *out]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line == f"replay: this needs the package scipy.linalg: {how_to_install('replay')}"
