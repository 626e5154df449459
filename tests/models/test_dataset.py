"""The data set: its form in docs/formats.md, each refusal by its own test."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from log_writers import write_data_set

from models import dataset
from models.common.errors import ModelError
from models.corner_law import ClosedForm
from models.dataset import HEADER


def _lines(count: int = 40) -> list[str]:
    rng = np.random.default_rng(1)
    rows = [HEADER]
    for i in range(count):
        h, d = ("inf", "inf") if i % 10 == 0 else (f"{0.1 + 0.02 * i:g}", f"{0.05 + 0.01 * i:g}")
        values = ",".join(
            f"{v:.6g}" for v in (rng.normal(0, 0.1), 0.01, 20.0 + 0.1 * i, 0.0, 0.1, 0.0)
        )
        rows.append(f"{h},{d},{3000 + 50 * i},{values}")
    return rows


def _write(tmp_path: Path, lines: list[str]) -> Path:
    path = tmp_path / "data.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _replace(lines: list[str], line: int, column: int, value: str) -> list[str]:
    """``line`` counts from 1 with the header, as the messages do."""
    fields = lines[line - 1].split(",")
    fields[column] = value
    return [*lines[: line - 1], ",".join(fields), *lines[line:]]


def test_a_good_file_is_read_whole(tmp_path: Path) -> None:
    data = dataset.read(_write(tmp_path, _lines()))
    assert len(data) == 40
    assert data.free_air.sum() == 4
    assert data.wrench.shape == (40, 6)
    assert re.fullmatch("[0-9a-f]{64}", data.sha256)


def test_windows_line_ends_byte_order_mark_and_blank_lines_are_fine(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    path.write_bytes(b"\xef\xbb\xbf" + "\r\n".join([*_lines(), "", ""]).encode())
    assert len(dataset.read(path)) == 40


def test_written_data_reads_back(tmp_path: Path) -> None:
    data = ClosedForm().data_set()
    write_data_set(tmp_path / "out.csv", data)
    back = dataset.read(tmp_path / "out.csv")
    np.testing.assert_allclose(back.wrench, data.wrench, rtol=1e-7, atol=1e-12)
    assert np.array_equal(back.free_air, data.free_air)


@pytest.mark.parametrize(
    ("line", "column", "value", "message"),
    [
        (7, 5, "nan", "line 7, column Fz_N: is not a number"),
        (9, 0, "nan", "line 9, column h_m: is not a number"),
        (9, 0, "-0.1", "line 9, column h_m: is negative"),
        (9, 1, "-0.1", "line 9, column d_m: is negative"),
        (9, 2, "-3000", "line 9, column rpm: is negative"),
        (9, 2, "inf", "line 9, column rpm: must be finite"),
        (9, 8, "inf", "line 9, column Mz_Nm: must be finite"),
        (9, 4, "abc", "line 9, column Fy_N: 'abc' is not a number"),
        (9, 4, "", "line 9, column Fy_N: '' is not a number"),
        (9, 4, "1,2", "line 9 has 10 fields, not 9"),
    ],
)
def test_a_bad_value_is_refused_by_line_and_column(
    tmp_path: Path, line: int, column: int, value: str, message: str
) -> None:
    with pytest.raises(ModelError, match=re.escape(message)) as error:
        dataset.read(_write(tmp_path, _replace(_lines(), line, column, value)))
    assert "data.csv" in str(error.value)
    assert "\n" not in str(error.value)


def test_the_line_named_counts_blank_lines_too(tmp_path: Path) -> None:
    lines = _replace(_lines(), 7, 5, "nan")
    with pytest.raises(ModelError, match="line 9, column Fz_N"):
        dataset.read(_write(tmp_path, [lines[0], "", "", *lines[1:]]))


@pytest.mark.parametrize(
    "header", ["h,d,rpm,Fx,Fy,Fz,Mx,My,Mz", HEADER.replace("h_m,d_m", "d_m,h_m"), ""]
)
def test_another_header_is_refused(tmp_path: Path, header: str) -> None:
    with pytest.raises(ModelError, match="header must be exactly"):
        dataset.read(_write(tmp_path, [header, *_lines()[1:]]))


def test_duplicates_that_disagree_are_refused_naming_both_lines(tmp_path: Path) -> None:
    lines = _lines()
    fields = lines[12].split(",")
    fields[5] = str(float(fields[5]) + 0.5)
    with pytest.raises(ModelError, match="lines 13 and 42 are the same point but disagree in Fz_N"):
        dataset.read(_write(tmp_path, [*lines, ",".join(fields)]))


def test_duplicates_that_agree_are_merged_and_said(tmp_path: Path) -> None:
    data = dataset.read(_write(tmp_path, [*_lines(), _lines()[12]]))
    assert len(data) == 40
    assert "1 duplicate rows that agree were merged" in data.notes


def test_fewer_than_thirty_rows_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="has 29 usable rows; at least 30 are needed"):
        dataset.read(_write(tmp_path, _lines(29)))
    assert len(dataset.read(_write(tmp_path, _lines(30)))) == 30


@pytest.mark.parametrize("content", [b"", HEADER.encode(), b"\xff\xfe\x00"])
def test_empty_and_binary_files_are_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "data.csv"
    path.write_bytes(content)
    with pytest.raises(ModelError, match=r"data\.csv"):
        dataset.read(path)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"none\.csv: cannot be read"):
        dataset.read(tmp_path / "none.csv")


def test_rows_at_rest_are_dropped_but_not_with_a_load(tmp_path: Path) -> None:
    at_rest = "0.3,0.3,0,0,0,0,0,0,0"
    data = dataset.read(_write(tmp_path, [*_lines(), at_rest]))
    assert len(data) == 40
    assert any("at rest" in note for note in data.notes)
    with pytest.raises(ModelError, match="line 42 is at rest"):
        dataset.read(
            _write(tmp_path, [*_lines(), at_rest.replace("0,0,0,0,0,0,0", "0,0,0,1.5,0,0,0")])
        )


def test_rows_of_one_place_share_its_number() -> None:
    data = ClosedForm().data_set()
    pairs = list(zip(data.h.tolist(), data.d.tolist(), strict=True))
    number = dict(zip(pairs, data.locations.tolist(), strict=True))
    assert len(set(number.values())) == len(set(pairs)) == data.locations.max() + 1
    assert all(number[p] == n for p, n in zip(pairs, data.locations.tolist(), strict=True))


def test_the_split_is_eight_to_two_and_reproducible() -> None:
    data = ClosedForm().data_set()
    test, again = (dataset.held_out(data, np.random.default_rng(3)) for _ in range(2))
    assert test.sum() == pytest.approx(0.2 * len(data), abs=5), "to a place of five speeds"
    assert set(data.locations[test]).isdisjoint(data.locations[~test])
    assert not data.free_air[test].any()
    assert np.array_equal(test, again)


SIGMA_NAMES = [f"sigma_{name}" for name in dataset.COLUMNS[3:]]


def sigma_table(path, data, **changes):
    """The table of sigma that belongs to ``data``: 0.1 everywhere."""
    lines = [",".join(["h_m", "d_m", "rpm", "even", *SIGMA_NAMES])]
    for h, d, rpm in zip(data.h, data.d, data.rpm, strict=True):
        lines.append(",".join([f"{h:g}", f"{d:g}", f"{rpm:g}", "half", *["0.1"] * 6]))
    text = "\n".join(lines) + "\n"
    for old, new in changes.get("replace", ()):
        assert old in text
        text = text.replace(old, new, 1)
    path.write_text(text)
    return path


def test_sigma_is_found_by_place_and_speed(tmp_path):
    data = ClosedForm().data_set()
    data = data.take(np.flatnonzero(data.rpm == data.rpm[0])[::3])
    path = sigma_table(tmp_path / "sigma.csv", data)
    shuffled = data.take(np.random.default_rng(0).permutation(len(data)))
    path.write_text(path.read_text().replace(",half,0.1,", ",half,0.7,", 1))
    known = dataset.with_sigma(shuffled, path)
    first = (shuffled.h == data.h[0]) & (shuffled.d == data.d[0])
    assert known.sigma.shape == (len(data), 6)
    assert known.sigma[first, 0] == pytest.approx(0.7)
    assert known.sigma[~first] == pytest.approx(0.1)
    assert dataset.with_sigma(shuffled, path).take(np.flatnonzero(first)).sigma[
        0, 0
    ] == pytest.approx(0.7)


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("sigma_Fz_N", "sigma_F", "lacks the column 'sigma_Fz_N'"),
        (",half,0.1,", ",half,much,", "line 2 has a field that is no number"),
        (",half,0.1,", ",half,-1,", "line 2: sigma must be finite and not negative"),
        (",half,0.1,", ",half,nan,", "line 2: sigma must be finite and not negative"),
        ("\n0", "\n7", "has no line for h_m"),
    ],
)
def test_a_wrong_table_of_sigma_is_named(tmp_path, old, new, word):
    data = ClosedForm().data_set()
    data = data.take(np.flatnonzero((data.rpm == data.rpm[0]) & np.isfinite(data.h))[::3])
    path = sigma_table(tmp_path / "sigma.csv", data, replace=[(old, new)])
    with pytest.raises(ModelError, match=r"sigma table .*sigma\.csv") as found:
        dataset.with_sigma(data, path)
    assert word in str(found.value)
    with pytest.raises(ModelError, match="cannot be read"):
        dataset.with_sigma(data, tmp_path / "none.csv")
