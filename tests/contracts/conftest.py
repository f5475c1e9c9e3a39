"""The package as a user gets it: every listed folder in the place where it is installed."""

from __future__ import annotations

import shutil
import tomllib
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="session")
def project() -> dict[str, Any]:
    """`pyproject.toml`."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text())


@pytest.fixture(scope="session")
def folders(project: dict[str, Any]) -> dict[str, Path]:
    """Every listed package with the folder that its `package-dir` entry gives it."""
    setuptools = project["tool"]["setuptools"]
    places = {}
    for package in setuptools["packages"]:
        above = [p for p in setuptools["package-dir"] if package == p or package.startswith(f"{p}.")]
        base = max(above, key=len)
        places[package] = ROOT / setuptools["package-dir"][base] / package[len(base) + 1 :].replace(".", "/")
    return places


@pytest.fixture(scope="session")
def installed(folders: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that holds the listed packages, and only those, as `grape/...`."""
    site = tmp_path_factory.mktemp("site")
    for package, folder in folders.items():
        target = site / package.replace(".", "/")
        target.mkdir(parents=True, exist_ok=True)
        for file in folder.iterdir():
            if file.is_file():
                shutil.copy(file, target / file.name)
    return site
