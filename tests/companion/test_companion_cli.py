"""Bad input is one line and a documented exit code; nothing is imported that flight does not need."""

import json
import socket
import subprocess
import sys

import pytest
from fake_autopilot import FakeAutopilot, free_port
from patience import HANG_S

from companion.cli import main
from companion.vehicles import QUAD, TANDEM


def companion(*arguments, timeout=HANG_S):
    return subprocess.run(
        [sys.executable, "-m", "companion", *arguments],
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )


def one_line(run, code, *words):
    assert run.returncode == code, run.stderr
    lines = run.stderr.strip().splitlines()
    assert len(lines) == 1, run.stderr
    assert "Traceback" not in run.stderr
    for word in words:
        assert word in lines[0], lines[0]


def test_help_imports_nothing_heavy():
    code = "import sys, companion.cli as c\ntry: c.main(['--help'])\nexcept SystemExit: pass\n"
    code += "print([m for m in ('torch', 'scipy', 'pymavlink', 'filterpy') if m in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip().endswith("[]")


def test_flight_imports_neither_torch_nor_scipy():
    code = "import sys, models, companion.flight.loop\nmodels.load()\n"
    code += "print([m for m in ('torch', 'scipy', 'sklearn', 'matplotlib') if m in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["--connect", "udpx:1:2"], 2, ["udpx:1:2"]),
        (["--connect"], 2, ["--connect", "--help"]),
        (["--conect", "sim:"], 2, ["--help"]),
        (["--connect", "udp:127.0.0.1"], 2, ["HOST:PORT"]),
        (["--connect", "sim:nowhere"], 2, ["nowhere"]),
        (["--connect", "/dev/ttyNONE7"], 4, ["/dev/ttyNONE7", "no such device"]),
        (["--connect", "tcp:127.0.0.1:1"], 4, ["tcp:127.0.0.1:1"]),
        (["--connect", "udp:127.0.0.1:5", "--vehicle", "/no/such.toml"], 2, ["/no/such.toml"]),
        (["--connect", "udp:127.0.0.1:5", "--model", "/no/such"], 2, ["/no/such"]),
        (["--connect", "udp:127.0.0.1:5", "--signing-key", "/no/key"], 2, ["/no/key"]),
        (["--connect", "udp:127.0.0.1:5", "--duration", "-3"], 2, ["--duration"]),
        (["--connect", "udp:127.0.0.1:5", "--target-system", "0"], 2, ["--target-system"]),
        (["--connect", "udp:127.0.0.1:5", "--compare"], 2, ["--compare"]),
        (["--connect", "sim:", "--signing-key", "key"], 2, ["--signing-key", "--connect sim:"]),
        (["--connect", "sim:", "--check", "f.tlog"], 2, ["--connect", "--check FILE.tlog"]),
        (["--connect", "sim:", "--check", "--compare"], 2, ["--check", "--compare"]),
        (["--connect", "sim:", "--survey", "0.3:1"], 2, ["--survey", "--record"]),
        (["--connect", "sim:", "--survey", "0.3:1", "--record", "f.tlog", "--dry-run"], 2, ["--survey"]),
        (["--connect", "sim:", "--plot", "p.svg"], 2, ["--plot", "--compare"]),
        (["--connect", "udp:127.0.0.1:5", "--carrier", "acceleration", "--setpoint", "udpin:h:6"], 2, ["--carrier"]),
    ],
)  # fmt: skip
def test_wrong_arguments_are_one_line(arguments, code, words, capsys):
    """In this process: the tests below start one of its own, with arguments as wrong."""
    try:
        returned = main(arguments)
    except SystemExit as stop:
        returned = stop.code
    one_line(
        subprocess.CompletedProcess(arguments, returned, stderr=capsys.readouterr().err),
        code,
        *words,
    )


def test_unknown_options_are_the_parsers_business():
    run = companion("--connect", "udp:127.0.0.1:5", "--no-such-option")
    assert run.returncode == 2
    assert "--no-such-option" in run.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("mass_kg", "mas_kg", ["mass_kg", "missing"]),
        ("mass_kg = 4.6", "mass_kg = -4.6", ["mass_kg"]),
        ("mass_kg = 4.6", "mass_kg = 4.6\ncolour = 3", ["colour", "not known"]),
        ("0.092, 0.283, 0.245", "0.092, 0.283, 0.6", ["inertia_kgm2"]),
        ("esc = 2", "esc = 1", ["esc"]),
        ('target = "wall"', 'target = "wal"', ["target", "wal"]),
        ("mass_kg = 4.6", "mass_kg = ", ["TOML"]),
        ("fan = 2", "fan = 3", ["vane[2].fan"]),
    ],
)
def test_a_vehicle_file_with_a_typo_names_the_key(tmp_path, before, after, words):
    text = TANDEM.read_text()
    assert before in text
    path = tmp_path / "typo.toml"
    path.write_text(text.replace(before, after, 1))
    one_line(
        companion("--connect", "udp:127.0.0.1:5", "--vehicle", str(path)), 2, "typo.toml", *words
    )


def test_a_model_of_another_schema_is_refused(tmp_path):
    (tmp_path / "model.json").write_text(json.dumps({"schema": 999}))
    one_line(companion("--connect", "udp:127.0.0.1:5", "--model", str(tmp_path)), 2, "model.json")


@pytest.mark.parametrize(
    "command", [["--connect", "udp:127.0.0.1:1", "--vehicle", "quadd"], ["--vehicle", "tandm"]]
)
def test_a_vehicle_s_name_that_does_not_ship_is_refused_with_those_that_do(command, capsys):
    with pytest.raises(SystemExit) as left:
        main(command)
    assert left.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "those that do: quad, tandem" in line


def test_a_port_in_use_is_exit_code_4():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        one_line(companion("--connect", f"udp:127.0.0.1:{port}"), 4, str(port), "in use")


@pytest.mark.slow
def test_a_vehicle_that_is_never_heard_is_exit_code_4_and_said(tmp_path):
    report = tmp_path / "report.json"
    run = companion(
        "--connect",
        f"udp:127.0.0.1:{free_port()}",
        "--duration",
        "1.5",
        "--quiet",
        "--json",
        str(report),
    )
    one_line(run, 4, "nothing was heard")
    assert json.loads(report.read_text())["system"] is None


@pytest.mark.slow
def test_ctrl_c_fades_out_and_is_exit_code_130(tmp_path):
    import signal
    import time

    port, log = free_port(), tmp_path / "f.tlog"
    process = subprocess.Popen(
        [sys.executable, "-m", "companion", "--vehicle", "tandem", "--connect", f"udp:127.0.0.1:{port}", "--record",
         str(log), "--json", "-"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    with process, FakeAutopilot(port) as autopilot:
        try:
            autopilot.wait_for("SET_ATTITUDE_TARGET", 100)
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=HANG_S)
        finally:
            process.kill()
        time.sleep(0.1)
        assert autopilot.of_type("SET_POSITION_TARGET_LOCAL_NED"), (
            "it hands back with a position target"
        )
    assert process.returncode == 130
    assert "Traceback" not in err
    assert "companion: connected to system 1 (ardupilot)" in err.splitlines()
    assert json.loads(out)["commands"] >= 100
    assert log.stat().st_size > 10_000


def test_a_model_of_another_fan_is_refused_in_flight():
    run = companion("--connect", "udpin:127.0.0.1:1", "--vehicle", str(QUAD), "--model", "default")
    one_line(run, 2, "--model default", "another fan", "rotor radius")


@pytest.mark.slow
@pytest.mark.parametrize(("options", "said"), [([], "another fan"), (["--model", "none"], "")])
def test_another_vehicle_flies_without_a_model(options, said):
    with FakeAutopilot(port := free_port()) as autopilot:
        run = companion(
            "--connect",
            f"udpin:127.0.0.1:{port}",
            "--vehicle",
            str(QUAD),
            "--duration",
            "3",
            "--json",
            "-",
            *options,
        )
        assert autopilot.received
    assert run.returncode == 0, run.stderr
    assert said in run.stderr
    assert ("another fan" in run.stderr) is bool(said)
    assert (
        json.loads(run.stdout)["thrust"] is None or json.loads(run.stdout)["thrust"]["max"] == 0.0
    )


def test_an_odd_vehicle_file_is_flown_and_said(tmp_path):
    odd = tmp_path / "odd.toml"
    odd.write_text(TANDEM.read_text().replace("[0.0, 0.0, 0.05]", "[0.0, 0.0, -0.05]"))
    with FakeAutopilot(port := free_port()):
        run = companion(
            "--connect", f"udpin:127.0.0.1:{port}", "--vehicle", str(odd), "--duration", "1"
        )
    assert run.returncode == 0
    assert "odd.toml" in run.stderr
    assert "z is positive down" in run.stderr


def test_a_reader_that_leaves_early_gets_no_traceback():
    """As in ``companion … --compare | head -1``."""
    program = (
        "import companion.cli as cli\n"
        "cli._compare = lambda arguments: print('line\\n' * 100000) or 0\n"
        "raise SystemExit(cli.main(['--connect', 'sim:corner', '--compare']))\n"
    )
    writer = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert writer.stdout.readline() == "line\n"
    writer.stdout.close()
    errors = writer.stderr.read()
    assert (writer.wait(HANG_S), errors) == (0, "")
