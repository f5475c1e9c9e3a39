"""Maps in the format of the ROS map server: a YAML file and an image (PGM, PNG or BMP).

Source: nav2_map_server and map_server, map_io: `trinary`, `scale` and `raw` modes, thresholds, negation.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from grape.errors import FileError, InvalidInput, Problem, did_you_mean
from grape.mapping.occupancy import OCCUPIED, UNKNOWN, OccupancyGrid
from grape.messages import Array
from grape.navigation.grid import MOST_CELLS, GridSpec
from grape.yaml_document import Document, load_yaml

Mode = Literal["trinary", "scale", "raw"]
MODES = ("trinary", "scale", "raw")
KEYS = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh", "mode")
MOST_BYTES = 500_000_000  # of an image: four for each cell of the largest grid
_PGM_HEAD = re.compile(rb"P[25](?:\s|#[^\n]*\n)+(\d{1,9})(?:\s|#[^\n]*\n)+(\d{1,9})")
UNKNOWN_PIXEL = 205  # what the map server writes for unknown cells: between both usual thresholds


@dataclass(frozen=True, kw_only=True)
class MapFormat:
    """How pixels and occupancy go together.

    A pixel's darkness p is (255 - value) / 255, or value / 255 with `negate`. `trinary`: occupied above
    `occupied_thresh`, free below `free_thresh`, else unknown. `scale`: the same, and between the thresholds p is
    scaled to 1..99; transparent pixels are unknown. `raw`: the value is the occupancy, above 100 unknown.
    """

    mode: Mode = "trinary"
    occupied_thresh: float = 0.65
    free_thresh: float = 0.25
    negate: bool = False

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise InvalidInput(f"mode is one of {', '.join(MODES)}, got {self.mode!r}")
        if not 0.0 <= self.free_thresh < self.occupied_thresh <= 1.0:
            raise InvalidInput(
                f"0 <= free_thresh < occupied_thresh <= 1 needed, got {self.free_thresh} and {self.occupied_thresh}"
            )

    def occupancy(self, pixels: Array, alpha: Array | None = None) -> Array:
        """Occupancy (rows, columns) int8 of pixels uint8; `alpha` uint8 is used by `scale` alone."""
        result = self._occupancies(np.arange(256))[pixels]
        if self.mode == "scale" and alpha is not None:
            result[alpha < 255] = UNKNOWN
        return result

    def _occupancies(self, values: Array) -> Array:
        """Occupancy int8 of values of pixels."""
        if self.mode == "raw":
            return np.where(values > OCCUPIED, UNKNOWN, values).astype(np.int8)
        dark = (values if self.negate else 255 - values) / 255.0
        occupied, free = dark > self.occupied_thresh, dark < self.free_thresh
        between = np.full(values.shape, UNKNOWN)
        if self.mode == "scale":
            ratio = (dark - self.free_thresh) / (self.occupied_thresh - self.free_thresh)
            between = np.clip(np.rint(1 + 98 * ratio), 1, 99).astype(int)
        return np.where(occupied, OCCUPIED, np.where(free, 0, between)).astype(np.int8)

    def pixels(self, occupancy: Array) -> Array:
        """Pixels uint8 that give this occupancy when read; with (rows, columns, 2) value and alpha in `scale`.

        In `trinary` a cell in between is written as unknown.
        """
        known = occupancy >= 0
        if self.mode == "raw":
            return np.where(known, occupancy, 255).astype(np.uint8)
        if self.mode == "scale":
            inner = self.free_thresh + (occupancy - 1) / 98 * (self.occupied_thresh - self.free_thresh)
            dark = np.where(occupancy >= OCCUPIED, 1.0, np.where(occupancy <= 0, 0.0, inner))
            value = self._shade(dark)
            return np.dstack([value, np.where(known, 255, 0).astype(np.uint8)])
        occupied, free = occupancy >= 100 * self.occupied_thresh, known & (occupancy <= 100 * self.free_thresh)
        unknown = (self.free_thresh + self.occupied_thresh) / 2
        shade = self._shade(np.where(occupied, 1.0, np.where(free, 0.0, unknown)))
        shade[~occupied & ~free] = self._unknown_pixel(unknown)
        return shade

    def _shade(self, dark: Array) -> Array:
        value = np.rint(255 * np.clip(dark, 0.0, 1.0)).astype(np.uint8)
        return value if self.negate else 255 - value

    def _unknown_pixel(self, middle: float) -> int:
        usual = (UNKNOWN_PIXEL if self.negate else 255 - UNKNOWN_PIXEL) / 255.0
        if self.free_thresh <= usual <= self.occupied_thresh:
            return UNKNOWN_PIXEL
        return int(self._shade(np.array(middle)))


def save_map(grid: OccupancyGrid, path: Path, format: MapFormat | None = None) -> Path:
    """Write `path` (.yaml) and its image beside it; returns the path of the image.

    The image is a PGM; in `scale` mode a PNG with alpha, for a PGM cannot say what is unknown there.

    Raises:
        InvalidInput: the path does not end in .yaml, or the image cannot be written.
    """
    import cv2

    format = format or MapFormat()
    if path.suffix not in (".yaml", ".yml"):
        raise InvalidInput(f"a map's file ends in .yaml, got {path}")
    pixels = np.flipud(format.pixels(grid.occupancy))
    image = path.with_suffix(".png" if pixels.ndim == 3 else ".pgm")
    if pixels.ndim == 3:
        pixels = np.dstack([pixels[..., :1]] * 3 + [pixels[..., 1:]])
    if not cv2.imwrite(str(image), np.ascontiguousarray(pixels)):
        raise InvalidInput(f"{image} cannot be written")
    spec = grid.spec
    path.write_text(
        f"image: {image.name}\nmode: {format.mode}\nresolution: {float(spec.resolution)!r}\n"
        f"origin: [{float(spec.x_min)!r}, {float(spec.y_min)!r}, 0.0]\nnegate: {int(format.negate)}\n"
        f"occupied_thresh: {format.occupied_thresh!r}\nfree_thresh: {format.free_thresh!r}\n",
        encoding="utf-8",
    )
    return image


def load_map(path: Path) -> OccupancyGrid:
    """Read a map's YAML and its image (relative to the YAML).

    Raises:
        FileError: every problem of the YAML with its line, or what is wrong with the image.
    """
    document = load_yaml(path)
    problems = _problems(document)
    if problems:
        raise FileError(problems)
    data = document.data
    format = MapFormat(
        mode=data.get("mode", "trinary"),
        occupied_thresh=float(data.get("occupied_thresh", 0.65)),
        free_thresh=float(data.get("free_thresh", 0.25)),
        negate=bool(data.get("negate", 0)),
    )
    pixels, alpha = _read_image(path.parent / data["image"], document)
    rows, columns = pixels.shape
    x, y, _ = data["origin"]
    spec = GridSpec(x_min=float(x), y_min=float(y), rows=rows, columns=columns, resolution=float(data["resolution"]))
    return OccupancyGrid(spec=spec, occupancy=np.flipud(format.occupancy(pixels, alpha)))


def _problems(document: Document) -> list[Problem]:
    data = document.data
    found = [
        document.problem((key,), "unknown key", ", ".join(KEYS), did_you_mean(key, KEYS))
        for key in data
        if key not in KEYS
    ]
    found += [document.problem((key,), "is missing") for key in KEYS[:3] if key not in data]

    def require(key: str, right: bool, allowed: str) -> None:
        if key in data and not right:
            found.append(document.problem((key,), f"got {data[key]!r}", allowed))

    image, origin, resolution = data.get("image"), data.get("origin"), data.get("resolution")
    named = isinstance(image, str) and image != "" and "\0" not in image
    require("image", named, "name of a PGM, PNG or BMP file")
    require("resolution", _is_number(resolution) and 0.0 < float(resolution or 0) < 100.0, "metres a pixel, above 0")
    triple = isinstance(origin, list) and len(origin) == 3 and all(_is_number(value) for value in origin)
    require("origin", triple, "[x, y, yaw] of the lower left pixel, in metres and radians")
    if isinstance(origin, list) and triple and abs(origin[2]) > 1e-9:
        found.append(document.problem(("origin", 2), f"yaw {origin[2]}", "0: a turned map is not supported"))
    require("negate", data.get("negate") in (0, 1), "0 or 1")
    require("mode", data.get("mode") in MODES, ", ".join(MODES))
    for key in ("occupied_thresh", "free_thresh"):
        require(key, _is_number(data.get(key)) and 0.0 <= float(data.get(key) or 0) <= 1.0, "0 to 1")
    occupied, free = data.get("occupied_thresh", 0.65), data.get("free_thresh", 0.25)
    if not found and not free < occupied:
        found.append(document.problem(("free_thresh",), f"got {free}", f"less than occupied_thresh, {occupied}"))
    return found


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _pixels(raw: bytes) -> int | None:
    """How many pixels the head of a PGM, PNG or BMP image promises; None of what is none of these."""
    if head := _PGM_HEAD.match(raw):
        return int(head[1]) * int(head[2])
    if raw.startswith(b"\x89PNG\r\n\x1a\n"):
        return int.from_bytes(raw[16:20], "big") * int.from_bytes(raw[20:24], "big")
    if raw.startswith(b"BM"):
        return abs(_signed(raw[18:22]) * _signed(raw[22:26]))
    return None


def _signed(raw: bytes) -> int:
    return int.from_bytes(raw, "little", signed=True)


def _read_image(path: Path, document: Document) -> tuple[Array, Array | None]:
    import cv2

    def refuse(got: str, allowed: str) -> FileError:
        return FileError([document.problem(("image",), f"{path}: {got}", allowed)])

    try:
        with path.open("rb") as stream:
            raw = stream.read(MOST_BYTES + 1)
    except OSError as error:
        raise refuse(f"cannot be read: {error.strerror}", "an image beside the YAML file") from error
    if len(raw) > MOST_BYTES:
        raise refuse("is too large", f"at most {MOST_BYTES} bytes")
    size = _pixels(raw)
    if raw and size is None:
        raise refuse(f"starts with {raw[:2]!r}", "a grey PGM (P2 or P5), a PNG or a BMP")
    if size is not None and size > MOST_CELLS:
        raise refuse(f"has {size} pixels", f"at most {MOST_CELLS}")
    image = cv2.imdecode(np.frombuffer(raw, np.uint8), cv2.IMREAD_UNCHANGED) if raw else None
    if image is None:
        raise refuse("cannot be decoded, or is cut off", "a whole PGM, PNG or BMP image")
    if image.dtype != np.uint8:
        raise refuse(f"has {8 * image.dtype.itemsize} bits a pixel", "8 bits")
    if image.ndim == 2:
        return image, None
    alpha = image[..., 3] if image.shape[2] in (2, 4) else None
    return np.rint(image[..., : min(image.shape[2], 3)].mean(axis=2)).astype(np.uint8), alpha
