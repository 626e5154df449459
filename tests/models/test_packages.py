"""What a library user sees: exported names, versions, type information, and what an import costs."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

import pytest

PACKAGES = ("models", "companion", "replay")
LIBRARIES = ("models", "replay")
"""``companion`` is a program: a replay imports what it needs from its modules."""


@pytest.mark.parametrize("package", LIBRARIES)
def test_every_exported_name_exists_and_is_listed(package: str) -> None:
    module = import_module(package)
    for name in module.__all__:
        assert getattr(module, name) is not None
        assert name in dir(module)
    with pytest.raises(AttributeError, match="no attribute"):
        module.nothing_of_this_name  # noqa: B018


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_carry_type_information(package: str) -> None:
    assert (Path(str(import_module(package).__file__)).parent / "py.typed").exists()


@pytest.mark.parametrize("package", LIBRARIES)
def test_libraries_carry_a_version(package: str) -> None:
    assert import_module(package).__version__ == version("corner-compensator")


@pytest.mark.parametrize("package", PACKAGES)
def test_version_option(package: str) -> None:
    out = subprocess.run(
        [sys.executable, "-m", package, "--version"], capture_output=True, text=True, check=True
    )
    assert out.stdout.split() == [package, version("corner-compensator")]


@pytest.mark.parametrize("package", PACKAGES)
def test_importing_a_package_imports_no_library(package: str) -> None:
    code = f"import sys, {package}; print([m for m in ('numpy', 'torch', 'scipy', 'pymavlink') if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"
