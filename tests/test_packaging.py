"""The package that a user installs holds every folder and data file of the repository."""

from __future__ import annotations

import tomllib
from fnmatch import fnmatch
from pathlib import Path

ROOT = Path(__file__).parents[1]
SETUPTOOLS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
FOLDERS = {folder: package for package, folder in SETUPTOOLS["package-dir"].items()}


def test_every_package_on_disk_is_listed_and_the_other_way_round() -> None:
    found = set()
    for folder, package in FOLDERS.items():
        for init in (ROOT / folder).rglob("__init__.py"):
            below = init.parent.relative_to(ROOT / folder).parts
            found.add(".".join((package, *below)))
    assert found == set(SETUPTOOLS["packages"])


def test_every_data_file_is_taken_along() -> None:
    patterns = SETUPTOOLS["package-data"]["*"]
    for folder in FOLDERS:
        for path in (ROOT / folder).rglob("*"):
            if path.is_dir() or path.suffix in (".py", ".pyc", ".nbi", ".nbc") or path.name.startswith("."):
                continue
            package = next(parent for parent in path.parents if (parent / "__init__.py").exists())
            name = path.relative_to(package).as_posix()
            assert any(fnmatch(name, pattern) for pattern in patterns), f"{path} is in no package-data pattern"


def test_the_lock_fits_the_declared_ranges() -> None:
    from importlib.metadata import version

    from packaging.requirements import Requirement
    from packaging.utils import canonicalize_name

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lines = [*(ROOT / "requirements.lock").open(), *(ROOT / "requirements-test.lock").open()]
    locked = dict(line.strip().split("==") for line in lines if not line.startswith("#"))
    exact = {canonicalize_name(name): number for name, number in locked.items()}
    for text in [*project["dependencies"], *project["optional-dependencies"]["test"]]:
        requirement = Requirement(text)
        assert requirement.specifier.contains(exact[canonicalize_name(requirement.name)]), text
    assert version("grape") == project["version"]
