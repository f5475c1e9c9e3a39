"""What is on disk is what gets installed: a sub-package that is not listed vanishes without a word."""

from __future__ import annotations

import fnmatch
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
SOURCES = {
    "grape": "grape",
    "robots": "grape.robots",
    "tasks": "grape.tasks",
    "trees": "grape.trees",
    "sim": "grape.sim",
    "experiments": "grape.experiments",
}


def packages_on_disk() -> set[str]:
    found = set()
    for folder, package in SOURCES.items():
        for file in (ROOT / folder).rglob("*.py"):
            below = file.parent.relative_to(ROOT / folder).parts
            found.add(".".join((package, *below)))
    return found


def test_every_package_on_disk_is_listed_and_every_listed_one_is_there(project: dict[str, Any]) -> None:
    listed = project["tool"]["setuptools"]["packages"]
    assert len(listed) == len(set(listed))
    assert set(listed) == packages_on_disk()


def test_every_package_has_an_init_file(folders: dict[str, Path]) -> None:
    assert [package for package, folder in folders.items() if not (folder / "__init__.py").is_file()] == []


def test_every_data_file_in_a_package_is_installed(project: dict[str, Any]) -> None:
    patterns = project["tool"]["setuptools"]["package-data"]["*"]
    tracked = subprocess.run(
        ["git", "ls-files", *SOURCES], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    folders = {ROOT / folder for folder in SOURCES}
    left_out = []
    for name in tracked:
        path = ROOT / name
        packages = [
            p for p in path.parents if (p / "__init__.py").is_file() and any(f in (p, *p.parents) for f in folders)
        ]
        relative = str(path.relative_to(packages[0])) if packages else name
        if path.suffix != ".py" and not any(fnmatch.fnmatch(relative, pattern) for pattern in patterns):
            left_out.append(name)
    assert left_out == []


def test_importing_grape_loads_no_heavy_library_and_starts_nothing(installed: Path) -> None:
    code = (
        "import sys, threading, grape, grape.errors, grape.actions.core, grape.bt, grape.plugins\n"
        "heavy = {'mujoco', 'open3d', 'ompl', 'toppra', 'matplotlib', 'numba', 'cv2', 'pinocchio'} & set(sys.modules)\n"
        "print(sorted(heavy), threading.active_count())"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={"PYTHONPATH": str(installed), "PATH": ""},
        cwd=installed,
        capture_output=True,
        text=True,
    )
    assert done.stdout.split("\n")[0] == "[] 1", done.stderr
