"""Imports point downwards, as `[tool.importlinter]` in pyproject.toml says, on the package as it is installed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
LINT = "from importlinter.cli import lint_imports_command; lint_imports_command()"


def lint(site: Path, config: Path = ROOT / "pyproject.toml") -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", LINT, "--config", str(config), "--no-cache"],
        env={**os.environ, "PYTHONPATH": str(site)},
        cwd=site,
        capture_output=True,
        text=True,
    )


def test_no_import_points_upwards(installed: Path) -> None:
    done = lint(installed)
    assert done.returncode == 0, done.stdout + done.stderr


def test_an_import_that_points_upwards_is_found(installed: Path, tmp_path: Path) -> None:
    import shutil

    site = tmp_path / "site"
    shutil.copytree(installed, site)
    with (site / "grape" / "kinematics" / "__init__.py").open("a") as file:
        file.write("\nfrom grape.bt import TreeExecutor\n")
    done = lint(site)
    assert done.returncode == 1 and "grape.kinematics" in done.stdout and "Imports point downwards" in done.stdout


def test_a_module_without_a_place_in_the_layers_is_found(installed: Path, tmp_path: Path) -> None:
    import shutil

    site = tmp_path / "site"
    shutil.copytree(installed, site)
    (site / "grape" / "stray.py").write_text('"""Nobody said where this belongs."""\n')
    done = lint(site)
    assert done.returncode == 1 and "stray" in done.stdout
