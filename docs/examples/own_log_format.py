"""Read a log format of one's own: a CSV with a row a sample, in SI units, NED and FRD.

Installed as a package (docs/library.md says how), every command of replay reads it. Without that:
python docs/examples/own_log_format.py flight.mycsv
"""

import sys
from pathlib import Path

import numpy as np

from models.common.errors import LogError
from replay import FlightLog
from replay.flightlog import ImuRecord, LogSummary, Series

COLUMNS = ("t_s", "qw", "qx", "qy", "qz", "ax", "ay", "az", "p", "q", "r")
"""Time since boot, attitude, specific force [m/s^2] and rates [rad/s]."""


def read(path: Path) -> list[FlightLog]:
    """The one flight of a file. Raises LogError, in one line, where it is of another kind."""
    with path.open() as file:
        head = file.readline().strip()
        if head != ",".join(COLUMNS):
            raise LogError(f"{path}: its first line is not {','.join(COLUMNS)}")
        rows = np.loadtxt(file, delimiter=",", ndmin=2)
    t_s = rows[:, 0]
    imu = ImuRecord(
        source="IMU",
        specific_force=Series(t_s, rows[:, 5:8], "ax ay az"),
        gyro=Series(t_s, rows[:, 8:11], "p q r"),
        force_step=0.0,
        clipped=0,
    )
    log = FlightLog(
        path=path,
        system=1,
        boot=0,
        start_s=float(t_s[0]),
        end_s=float(t_s[-1]),
        attitude=Series(t_s, rows[:, 1:5], "qw qx qy qz"),
        imus=(imu,),
        summary=LogSummary(path.stat().st_size, len(t_s), ()),
    )
    return [log]


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    (flight,) = read(Path(sys.argv[1]))
    assert flight.attitude is not None
    print(f"{flight.duration_s:.1f} s, {len(flight.attitude)} attitudes")
