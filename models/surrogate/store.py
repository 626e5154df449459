"""Model directories: model.json says what the model is, weights.npz holds its numbers; loading refuses any mismatch."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from models.common.errors import ModelError
from models.effects import adopted
from models.effects.adopted_effect import AdoptedEffect
from models.surrogate.coordinates import Coordinates
from models.surrogate.domain import Domain
from models.surrogate.fan_surrogate import Calibration, FanSurrogate, Regressor
from models.surrogate.free_air import FreeAir
from models.surrogate.kriging import KrigingRegressor
from models.surrogate.net_ensemble import NetEnsemble
from models.surrogate.polynomial import PolynomialRegressor

SCHEMA = 1
UNITS = {"h": "m", "d": "m", "rpm": "1/min", "force": "N", "moment": "N m"}
FRAME = "corner frame of one fan: X to the wall, Z up"
SHIPPED = Path(__file__).parents[1] / "weights"
DEFAULT = SHIPPED / "default"
REGRESSORS = {r.kind: r for r in (NetEnsemble, KrigingRegressor, PolynomialRegressor)}


def save_model(directory: Path | str, model: FanSurrogate) -> None:
    """Write a surrogate as a model directory; an existing one is replaced.

    Parameters
    ----------
    directory : path
        Made where there is none.
    model : FanSurrogate
        Its ``info`` is kept: a model with adopted effects stays what it was, plus its effects.

    Raises
    ------
    ModelError
        The directory cannot be written.

    Examples
    --------
    >>> import models
    >>> models.save_model("my-model", models.load())
    >>> models.load("my-model")
    FanSurrogate(method='ensemble', rows=2310, rotor_radius_m=0.165, effects=[])
    """
    directory = Path(directory)
    arrays = {**model.regressor.arrays(), "domain_map": model.domain.map}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]
    weights = buffer.getvalue()
    domain = {k: v for k, v in asdict(model.domain).items() if k != "map"}
    manifest = {
        **model.info,
        "schema": SCHEMA,
        "units": UNITS,
        "frame": FRAME,
        "regressor": model.regressor.kind,
        "free_air": asdict(model.free_air_law),
        "coordinates": asdict(model.coordinates),
        "calibration": asdict(model.calibration),
        "domain": domain,
        "effects": [_entry(e) for e in model.effects],
        "weights": {"file": "weights.npz", "sha256": hashlib.sha256(weights).hexdigest()},
    }
    try:
        directory.mkdir(parents=True, exist_ok=True)
        (directory / "weights.npz").write_bytes(weights)
        (directory / "model.json").write_text(
            json.dumps(manifest, indent=1) + "\n", encoding="utf-8"
        )
    except OSError as error:
        raise ModelError(
            f"model directory {directory}: cannot be written ({error.strerror})"
        ) from None


def load(directory: Path | str | None = None) -> FanSurrogate:
    """Load the surrogate of a fan.

    Parameters
    ----------
    directory : path, str or None
        A model directory, or the name of a shipped model. None: the shipped default.

    Returns
    -------
    FanSurrogate
        It needs numpy alone.

    Raises
    ------
    ModelError
        A file is missing, damaged or of another schema, or the weights are not those that were declared.

    Examples
    --------
    >>> import models
    >>> fan = models.load()
    >>> fan
    FanSurrogate(method='ensemble', rows=2310, rotor_radius_m=0.165, effects=[])
    >>> float(fan.wrench(h=0.3, d=0.2, rpm=4000.0)[2].round(1))  # lift [N], 0.3 m up and 0.2 m from a wall
    22.8
    """
    if directory is None:
        directory = DEFAULT
    else:
        directory = _place(Path(directory))
    path = directory / "model.json"
    with _named(path):
        manifest = json.loads(path.read_text(encoding="utf-8"))
        _check_schema(manifest)
        weights = directory / str(manifest["weights"]["file"])
        sha256 = manifest["weights"]["sha256"]
    with _named(weights):
        raw = weights.read_bytes()
        if hashlib.sha256(raw).hexdigest() != sha256:
            raise ModelError(
                "does not have the hash that model.json declares; train the model again"
            )
        with np.load(io.BytesIO(raw), allow_pickle=False) as archive:
            arrays = dict(archive)
    with _named(path):
        regressor: Regressor = REGRESSORS[manifest["regressor"]].from_arrays(arrays)
        return FanSurrogate(
            free_air_law=FreeAir(**_tuples(manifest["free_air"])),
            coordinates=Coordinates(**manifest["coordinates"]),
            regressor=regressor,
            calibration=Calibration(**_tuples(manifest["calibration"])),
            domain=Domain(arrays["domain_map"], **manifest["domain"]),
            effects=tuple(map(_effect, manifest["effects"])),
            info={k: v for k, v in manifest.items() if k not in _OWN_KEYS},
        )


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """What is wrong with a model file, as one ModelError that names it."""
    try:
        yield
    except OSError as error:
        what = (
            f"cannot be read ({error.strerror}); give a directory that 'replay diagnose "
            "--save-model' or 'models train --out' wrote"
        )
    except KeyError as error:
        what = f"{error} is missing or not known; train the model again"
    except (TypeError, ValueError, AttributeError, EOFError, zipfile.BadZipFile) as error:
        what = f"is damaged ({error}); train the model again"
    except ModelError as error:
        what = str(error)
    else:
        return
    raise ModelError(f"model file {path}: {what}")


def _place(directory: Path) -> Path:
    """The directory itself, or the shipped model of that name where there is no such directory."""
    shipped = SHIPPED / directory.name
    by_name = (
        len(directory.parts) == 1 and not directory.exists() and (shipped / "model.json").exists()
    )
    if by_name:
        return shipped
    return directory


_OWN_KEYS = {
    "free_air",
    "coordinates",
    "calibration",
    "domain",
    "schema",
    "units",
    "frame",
    "regressor",
    "effects",
    "weights",
}


def _check_schema(manifest: Mapping[str, Any]) -> None:
    found = manifest.get("schema")
    if found != SCHEMA:
        raise ModelError(f"schema is {found!r}, this program reads {SCHEMA}; train the model again")
    if manifest.get("units") != UNITS or manifest.get("frame") != FRAME:
        raise ModelError(
            f"units or frame are not {UNITS} in the corner frame; train the model again"
        )


def _tuples(section: Mapping[str, Any]) -> dict[str, Any]:
    out = {}
    for k, v in section.items():
        out[k] = tuple(v) if isinstance(v, list) else v
    return out


def _entry(e: AdoptedEffect) -> dict[str, Any]:
    entry = {"name": e.name, "parameters": dict(e.parameters)}
    return entry | ({"without": list(e.without)} if e.without else {})


def _effect(entry: Mapping[str, Any]) -> AdoptedEffect:
    parameters = {str(k): float(v) for k, v in entry["parameters"].items()}
    return adopted(str(entry["name"]), parameters, tuple(entry.get("without", ())))
