"""Maps keep their cells through a file in every mode; what is wrong with a file is said with its place."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from grape.errors import FileError, InvalidInput
from grape.mapping import MapFormat, OccupancyGrid, load_map, save_map
from grape.navigation.grid import GridSpec

SPEC = GridSpec(x_min=-1.5, y_min=2.0, columns=7, rows=5)
GOOD = "image: m.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n"


def grid(values: tuple[int, ...]) -> OccupancyGrid:
    chosen = np.random.default_rng(0).choice(values, size=(SPEC.rows, SPEC.columns))
    return OccupancyGrid(spec=SPEC, occupancy=chosen)


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("negate", [False, True])
@pytest.mark.parametrize("thresholds", [(0.65, 0.25), (0.65, 0.196), (0.9, 0.5), (0.2, 0.1)])
def test_three_values_survive_every_format(
    tmp_path: Path, mode: str, negate: bool, thresholds: tuple[float, float]
) -> None:
    before = grid((-1, 0, 100))
    format = MapFormat(mode=mode, negate=negate, occupied_thresh=thresholds[0], free_thresh=thresholds[1])  # type: ignore[arg-type]
    image = save_map(before, tmp_path / "m.yaml", format)
    after = load_map(tmp_path / "m.yaml")
    assert image.exists() and after.spec == before.spec
    np.testing.assert_array_equal(after.occupancy, before.occupancy)


def test_raw_keeps_every_percentage_and_scale_nearly(tmp_path: Path) -> None:
    before = grid((-1, 0, 13, 50, 77, 100))
    save_map(before, tmp_path / "raw.yaml", MapFormat(mode="raw"))
    np.testing.assert_array_equal(load_map(tmp_path / "raw.yaml").occupancy, before.occupancy)
    save_map(before, tmp_path / "scale.yaml", MapFormat(mode="scale", free_thresh=0.1, occupied_thresh=0.9))
    assert np.abs(load_map(tmp_path / "scale.yaml").occupancy - before.occupancy).max() <= 1


def test_the_first_row_of_the_image_is_the_top_of_the_map(tmp_path: Path) -> None:
    pixels = b"\xfe" * 6 + b"\x00" * 2  # two columns, four rows, the last row dark
    (tmp_path / "m.pgm").write_bytes(b"P5\n2 4\n255\n" + pixels)
    (tmp_path / "m.yaml").write_text(GOOD)
    loaded = load_map(tmp_path / "m.yaml")
    assert loaded.occupancy[0].tolist() == [100, 100] and loaded.occupancy[3].tolist() == [0, 0]
    assert loaded.at(np.array([[0.01, 0.01], [0.01, 0.19], [5.0, 5.0]])).tolist() == [100, 0, -1]


def test_thresholds_are_exclusive() -> None:
    format = MapFormat(occupied_thresh=100 / 255, free_thresh=50 / 255)
    pixels = np.array([[155, 154, 205, 206]], np.uint8)  # darkness 100, 101, 50 and 49 of 255
    assert format.occupancy(pixels).tolist() == [[-1, 100, -1, 0]]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (GOOD.replace("negate", "negat"), "m.yaml:4:1: negat: unknown key"),
        (GOOD.replace("0.05", "-1"), "m.yaml:2:1: resolution: got -1"),
        (GOOD.replace("[0, 0, 0]", "[0, 0]"), "m.yaml:3:1: origin: got [0, 0]"),
        (GOOD.replace("[0, 0, 0]", "[0, 0, 1.5]"), "yaw 1.5"),
        (GOOD.replace("0.65", "0.2"), "free_thresh: got 0.25; allowed: less than occupied_thresh, 0.2"),
        (GOOD + "mode: tri\n", "m.yaml:7:1: mode: got 'tri'; allowed: trinary, scale, raw"),
        (GOOD.replace("m.pgm", "gone.pgm"), "gone.pgm: cannot be read"),
        (GOOD.replace("m.pgm", "cut.pgm"), "cut.pgm: cannot be decoded, or is cut off"),
        (GOOD.replace("m.pgm", "colour.ppm"), "colour.ppm: starts with b'P6'"),
        (GOOD.replace("m.pgm", "huge.pgm"), "huge.pgm: has 10000000000 pixels"),
        (GOOD.replace("m.pgm", "huge.png"), "huge.png: has 900000000 pixels"),
        (GOOD.replace("m.pgm", "huge.bmp"), "huge.bmp: has 900000000 pixels"),
        (GOOD.replace("m.pgm", '"\\0"'), "m.yaml:1:1: image: got"),
        ("image: m.pgm\n", "origin: is missing"),
    ],
)
def test_what_is_wrong_is_said_with_its_place(tmp_path: Path, text: str, expected: str) -> None:
    (tmp_path / "m.pgm").write_bytes(b"P5\n2 2\n255\n\x00\x00\x00\x00")
    (tmp_path / "cut.pgm").write_bytes(b"P5\n2 2\n255\n\x00")
    (tmp_path / "colour.ppm").write_bytes(b"P6\n1 1\n255\n\x00\x00\x00")
    (tmp_path / "huge.pgm").write_bytes(b"P5\n# by hand\n100000 100000\n255\n")
    (tmp_path / "huge.png").write_bytes(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + 2 * (30_000).to_bytes(4, "big"))
    (tmp_path / "huge.bmp").write_bytes(b"BM" + bytes(16) + struct.pack("<ii", 30_000, -30_000))
    (tmp_path / "m.yaml").write_text(text)
    with pytest.raises(FileError) as error:
        load_map(tmp_path / "m.yaml")
    assert expected in str(error.value)


def test_every_problem_is_listed(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text("resolution: 0\nmode: x\n")
    with pytest.raises(FileError) as error:
        load_map(tmp_path / "m.yaml")
    assert len(error.value.problems) == 4


@pytest.mark.parametrize("far", [1e7, 1e12, 1e18, np.inf, np.nan])
def test_grids_around_points_that_are_too_far_apart_are_refused(far: float) -> None:
    with pytest.raises(InvalidInput):
        GridSpec.around(np.array([[0.0, 0.0], [far, -far]]), 1.0)
    with pytest.raises(InvalidInput, match="too large"):
        GridSpec(x_min=0.0, y_min=0.0, columns=np.int64(2**32), rows=np.int64(2**32))


def test_grids_refuse_other_values() -> None:
    with pytest.raises(InvalidInput, match="-1 to 100"):
        OccupancyGrid(spec=SPEC, occupancy=np.full((5, 7), 101))
    with pytest.raises(InvalidInput, match="must be"):
        OccupancyGrid(spec=SPEC, occupancy=np.zeros((5, 6), np.int8))
    with pytest.raises(InvalidInput, match="free_thresh"):
        MapFormat(occupied_thresh=0.2, free_thresh=0.3)
