"""What a generated vineyard may look like: one flat, checked set of values, reached by `--set world.KEY=VALUE`."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from grape.config import model_of
from grape.errors import InvalidInput

FIRST_MARKER_ID = 10  # lower ids of DICT_4X4_50 belong to the feeder
MARKER_IDS = 50

Style = Literal["cordon", "gobelet"]
SunPreset = Literal["noon", "low", "overcast"]


def _number(low: float, high: float) -> Any:
    return Field(ge=low, le=high, allow_inf_nan=False)


WalkerKind = Literal["person", "dog", "boar"]
Coordinate = Annotated[float, _number(-1000.0, 1000.0)]


@dataclass(frozen=True, kw_only=True)
class WalkerOptions:
    """Who walks where; an item of `world.walkers`.

    Attributes:
        path: waypoints (x, y) in m, map frame; the walker stands at the first until `start_s`.
        speed: m/s between waypoints.
        wait_s: how long it stands at each waypoint after the first.
        loop: from the last waypoint on to the first, and so on; else it stays at the last.

    Raises:
        InvalidInput: a value is out of its range.
    """

    id: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$", max_length=40)]
    path: Annotated[tuple[tuple[Coordinate, Coordinate], ...], Field(min_length=1, max_length=1000)]
    kind: WalkerKind = "person"
    speed: Annotated[float, _number(0.05, 3.0)] = 1.2
    start_s: Annotated[float, _number(0.0, 86400.0)] = 0.0
    wait_s: Annotated[float, _number(0.0, 86400.0)] = 0.0
    loop: bool = False

    def __post_init__(self) -> None:
        _check_ranges("walker", self)


@dataclass(frozen=True, kw_only=True)
class VineyardOptions:
    """Options of the vineyard generator; lengths in metres, slopes as rise over run, sun angles in degrees.

    Raises:
        InvalidInput: a value is out of its range, or values do not fit together.

    Source: facts sheet, section 4 (vineyards).
    """

    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 0
    style: Style = "cordon"
    rows: Annotated[int, Field(ge=1, le=50)] = 3
    vines_per_row: Annotated[int, Field(ge=1, le=200)] = 8
    row_spacing: Annotated[float, _number(1.8, 6.0)] = 2.6
    vine_spacing: Annotated[float, _number(0.8, 3.0)] = 1.15
    slope: Annotated[float, _number(-0.4, 0.4)] = 0.03  # along the rows, positive uphill towards +x
    roughness_rms: Annotated[float, _number(0.0, 0.1)] = 0.015
    roughness_correlation: Annotated[float, _number(0.15, 5.0)] = 0.3  # distance at which correlation is 1/e
    terrain_resolution: Annotated[float, _number(0.04, 0.5)] = 0.1
    weeds: Annotated[float, _number(0.0, 5.0)] = 0.6  # clumps per metre of row
    post_spacing: Annotated[float, _number(1.0, 20.0)] = 4.6  # rounded to whole vine spacings
    post_height: Annotated[float, _number(1.3, 2.5)] = 1.7
    nails_per_row: Annotated[int, Field(ge=0, le=20)] = 2  # inner posts first, then the far and the near end post
    nail_height: Annotated[float, _number(0.4, 1.2)] = 0.8  # of the tip, above the ground at its post
    uncut_canes: Annotated[float, _number(0.0, 1.0)] = 0.15  # chance that a vine keeps one
    sun: SunPreset = "noon"
    sun_azimuth: Annotated[float, _number(-360.0, 360.0)] | None = None  # where it stands, clockwise from north
    sun_elevation: Annotated[float, _number(1.0, 90.0)] | None = None
    sun_strength: Annotated[float, _number(0.0, 2.0)] = 1.0
    glare: Annotated[float, _number(0.0, 1.0)] = 0.0  # how glossy the markers' prints are
    datum_latitude: Annotated[float, _number(-85.0, 85.0)] = 42.3415  # Garriguella, Catalonia
    datum_longitude: Annotated[float, _number(-180.0, 180.0)] = 3.0632
    datum_altitude: Annotated[float, _number(-500.0, 6000.0)] = 60.0
    walkers: Annotated[tuple[WalkerOptions, ...], Field(max_length=20)] = ()  # people and animals that walk around

    def __post_init__(self) -> None:
        _check_ranges("vineyard", self)
        ids = [walker.id for walker in self.walkers]
        if len(set(ids)) < len(ids):
            raise InvalidInput(f"walkers: each needs an id of its own, got {', '.join(ids)}")
        posts = len(post_stations(self))
        if self.nails_per_row > posts:
            raise InvalidInput(
                f"nails_per_row is {self.nails_per_row}, but a row has {posts} posts: allowed are at most {posts}, "
                "or a smaller post_spacing"
            )
        markers = 2 * self.nails_per_row * self.rows
        if FIRST_MARKER_ID + markers > MARKER_IDS:
            raise InvalidInput(
                f"nails_per_row is {self.nails_per_row} in {self.rows} rows: that takes {markers} marker ids, "
                f"and {MARKER_IDS - FIRST_MARKER_ID} are free"
            )


def _check_ranges(what: str, options: Any) -> None:
    kind: type = type(options)
    try:
        _ranges(kind).model_validate({f.name: getattr(options, f.name) for f in dataclasses.fields(options)})
    except ValidationError as error:
        texts = [f"{e['loc'][0]}: got {e['input']!r}; {e['msg']}" for e in error.errors()]
        raise InvalidInput(f"{what}: " + "; ".join(texts)) from None


@lru_cache(maxsize=2)
def _ranges(options: type) -> Any:
    return model_of(options)


def post_stations(options: VineyardOptions) -> list[float]:
    """x (m) of the posts of a row: half a vine spacing before the first vine, then every few vines, and at the end."""
    between = max(1, round(options.post_spacing / options.vine_spacing))
    first, n = -0.5 * options.vine_spacing, options.vines_per_row
    return [first + k * options.vine_spacing for k in (*range(0, n, between), n)]
