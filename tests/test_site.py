import json

import numpy as np
import pytest
from paper_names import NAMES, with_names

from grape.config import parse_yaml
from grape.errors import FileError, InvalidInput
from grape.geodesy import Datum, geodetic_from_enu
from grape.site import Area, Plant, RefillPoint, Row, Site, load_site, save_site
from grape.site_check import _places
from grape.site_features import PLACES

DATUM = Datum(latitude_deg=42.3415, longitude_deg=3.0632, altitude_m=60.0)


def small_site() -> Site:
    rows = (
        Row(id="r0", side="right", line=np.array([[0.0, 0.0], [9.2, 0.1]])),
        Row(id="r1", side="left", line=np.array([[0.0, 2.6], [4.0, 2.7], [9.2, 2.6]])),
    )
    nail = {"markers": (10, 11), "height_m": 0.8, "yaw_rad": -np.pi / 2, "reach_m": 0.096}
    plants = (
        Plant(id="r0v0", row="r0", kind="vine", side="right", position=np.array([0.575, 0.0])),
        Plant(id="r0n0", row="r0", kind="nail", side="right", position=np.array([4.6, 0.05]), **nail),
        Plant(id="r1v0", row="r1", kind="vine", side="left", position=np.array([0.575, 2.6])),
    )
    box = np.array([[-6.0, -3.0], [-1.0, -3.0], [-1.0, 5.0], [-6.0, 5.0]])
    return Site(
        datum=DATUM,
        rows=rows,
        plants=plants,
        headlands=(Area(id="west", polygon=box),),
        fences=(Area(id="f0", polygon=np.array([[0.0, -0.3], [9.2, -0.3], [9.2, 0.3], [0.0, 0.3]])),),
        start=np.array([-3.0, -1.3]),
        start_heading_rad=0.25,
        refills=(RefillPoint(id="shed", position=np.array([-4.0, 1.5]), yaw_rad=3.0),),
    )


@pytest.fixture
def document(tmp_path):
    """The small site as a JSON document, and a function that loads a changed one."""
    save_site(small_site(), tmp_path / "good.geojson")
    return json.loads((tmp_path / "good.geojson").read_text())


@pytest.fixture
def problems_of(tmp_path):
    def load(document) -> list:
        path = tmp_path / "site.geojson"
        path.write_text(document if isinstance(document, str) else json.dumps(document, indent=1))
        with pytest.raises(FileError) as caught:
            load_site(path)
        return list(caught.value.problems)

    return load


def feature(document, id):
    return next(f for f in document["features"] if f["properties"]["id"] == id)


def test_a_saved_site_is_read_back_within_a_millimetre(tmp_path):
    site = small_site()
    save_site(site, tmp_path / "a.geojson")
    back = load_site(tmp_path / "a.geojson")
    assert back.datum == site.datum
    for mine, yours in zip(site.rows + site.plants, back.rows + back.plants, strict=True):
        assert (mine.id, mine.side) == (yours.id, yours.side)
    for mine, yours in zip(site.rows, back.rows, strict=True):
        np.testing.assert_allclose(yours.line, mine.line, atol=1e-4)
    for mine, yours in zip(site.plants, back.plants, strict=True):
        np.testing.assert_allclose(yours.position, mine.position, atol=1e-4)
        assert (yours.row, yours.kind, yours.markers, yours.height_m) == (
            mine.row,
            mine.kind,
            mine.markers,
            mine.height_m,
        )
        assert yours.yaw_rad == pytest.approx(mine.yaw_rad, abs=1e-6)
        assert yours.reach_m == pytest.approx(mine.reach_m)
    for mine, yours in zip(site.headlands + site.fences, back.headlands + back.fences, strict=True):
        np.testing.assert_allclose(yours.polygon, mine.polygon, atol=1e-4)
    np.testing.assert_allclose(back.start, site.start, atol=1e-4)
    assert back.start_heading_rad == pytest.approx(0.25)
    ((shed,), (refill,)) = site.refills, back.refills
    np.testing.assert_allclose(refill.position, shed.position, atol=1e-4)
    assert (refill.id, refill.yaw_rad) == (shed.id, pytest.approx(shed.yaw_rad))
    assert not list(tmp_path.glob("*.part"))


def test_sides_and_directions_agree():
    right, left = small_site().rows
    assert right.aisle_normal @ [0, -1] > 0.99 and right.work_direction @ [1, 0] > 0.99
    assert left.aisle_normal @ [0, 1] > 0.99 and left.work_direction @ [-1, 0] > 0.99
    for row in (right, left):  # whoever drives the work direction in the aisle has the row on the left
        to_row = -row.aisle_normal
        assert row.work_direction[0] * to_row[1] - row.work_direction[1] * to_row[0] > 0.99


def test_a_nail_is_reached_in_front_of_its_post():
    nail = small_site().plant("r0n0")
    np.testing.assert_allclose(nail.target - nail.position, [0.0, -0.096], atol=1e-12)


def test_arrays_of_a_site_are_read_only():
    with pytest.raises(ValueError, match="read-only"):
        small_site().rows[0].line[0, 0] = 1.0


def test_an_unknown_plant_is_named_with_a_suggestion():
    with pytest.raises(InvalidInput, match="did you mean 'r0v0'"):
        small_site().plant("r0vO")


def test_a_fence_may_be_a_line_with_a_width(document, tmp_path):
    points = geodetic_from_enu(DATUM, np.array([[0.0, 5.0, 0.0], [4.0, 5.0, 0.0], [4.0, 8.0, 0.0]]))
    fence = feature(document, "f0")
    fence["geometry"] = {"type": "LineString", "coordinates": [[lon, lat] for lat, lon, _ in points]}
    fence["properties"]["width_m"] = 0.6
    (tmp_path / "b.geojson").write_text(json.dumps(document))
    first, second = load_site(tmp_path / "b.geojson").fences
    assert (first.id, second.id) == ("f0", "f0#1")
    np.testing.assert_allclose(first.polygon.min(axis=0), [-0.3, 4.7], atol=1e-4)
    np.testing.assert_allclose(second.polygon.max(axis=0), [4.3, 8.3], atol=1e-4)


def test_without_a_datum_the_map_begins_at_the_start(document, tmp_path):
    del document["datum"]
    (tmp_path / "b.geojson").write_text(json.dumps(document))
    site = load_site(tmp_path / "b.geojson")
    np.testing.assert_allclose(site.start, 0.0, atol=1e-6)
    np.testing.assert_allclose(site.rows[0].line[0], [3.0, 1.3], atol=1e-3)


def test_a_plant_takes_the_side_of_its_row_when_it_names_none(document, tmp_path):
    del feature(document, "r1v0")["properties"]["side"]
    (tmp_path / "b.geojson").write_text(json.dumps(document))
    assert load_site(tmp_path / "b.geojson").plant("r1v0").side == "left"


def test_properties_that_other_programs_add_do_not_disturb(document, tmp_path):
    feature(document, "r0v0")["properties"]["fid"] = 7
    document["crs"] = {"type": "name"}
    (tmp_path / "b.geojson").write_text("\ufeff" + json.dumps(document, indent="\t"))
    assert len(load_site(tmp_path / "b.geojson").plants) == 3


def swap(f):
    f["geometry"]["coordinates"].reverse()


BROKEN = {
    "unknown kind": ("r0v0", lambda f: f["properties"].update(kind="vien"), "'vien'", "did you mean 'vine'?"),
    "kind is no text": ("r0v0", lambda f: f["properties"].update(kind=["vine"]), "got kind", ""),
    "no id": ("r0v0", lambda f: f["properties"].pop("id"), "got id nothing", ""),
    "empty id": ("r0v0", lambda f: f["properties"].update(id=" "), "got id ' '", ""),
    "duplicate id": ("r1v0", lambda f: f["properties"].update(id="r0v0"), "used twice", ""),
    "unknown row": ("r0v0", lambda f: f["properties"].update(row="r00"), "unknown row 'r00'", "did you mean"),
    "wrong side": ("r0", lambda f: f["properties"].update(side="rigth"), "'rigth'", "did you mean 'right'?"),
    "row without side": ("r0", lambda f: f["properties"].pop("side"), "got side nothing", ""),
    "latitude out of range": (
        "r0v0",
        lambda f: f["geometry"].update(coordinates=[3.06, 142.3]),
        "got position",
        "swap",
    ),
    "longitude out of range": ("r0v0", lambda f: f["geometry"].update(coordinates=[503.0, 42.3]), "got position", ""),
    "swapped but possible": ("r0v0", swap, "more than 100 km", "swapped"),
    "not a number": ("r0v0", lambda f: f["geometry"].update(coordinates=[float("nan"), 42.3]), "nan", ""),
    "huge integer": ("r0v0", lambda f: f["geometry"].update(coordinates=[10**400, 42.3]), "got position", ""),
    "text for a number": ("r0v0", lambda f: f["geometry"].update(coordinates=["3.06", 42.3]), "got position", ""),
    "bool for a number": ("r0n0", lambda f: f["properties"].update(height_m=True), "got height_m True", ""),
    "position of one number": ("r0v0", lambda f: f["geometry"].update(coordinates=[3.06]), "got position", ""),
    "wrong geometry": ("r0v0", lambda f: f["geometry"].update(type="MultiPoint"), "'MultiPoint'", ""),
    "no geometry": ("r0v0", lambda f: f.update(geometry=None), "has geometry nothing", ""),
    "row of one point": ("r0", lambda f: f["geometry"]["coordinates"].pop(), "got [[", ""),
    "row of equal points": (
        "r0",
        lambda f: f["geometry"]["coordinates"].insert(0, f["geometry"]["coordinates"][0]),
        "equal",
        "",
    ),
    "open polygon": ("west", lambda f: f["geometry"]["coordinates"][0].pop(), "ring ends at", ""),
    "polygon of three": (
        "west",
        lambda f: f["geometry"].update(coordinates=[f["geometry"]["coordinates"][0][:3]]),
        "got",
        "",
    ),
    "polygon of one place": (
        "f0",
        lambda f: f["geometry"].update(coordinates=[f["geometry"]["coordinates"][0][:1] * 4]),
        "1 different positions",
        "",
    ),
    "polygon that crosses itself": (
        "f0",
        lambda f: f["geometry"]["coordinates"][0].__setitem__(slice(1, 3), f["geometry"]["coordinates"][0][2:0:-1]),
        "crosses itself",
        "",
    ),
    "polygon without end": (
        "f0",
        lambda f: f["geometry"].update(coordinates=[f["geometry"]["coordinates"][0] * 3000]),
        "a ring of",
        "",
    ),
    "polygons in one": ("f0", lambda f: f["geometry"].update(type="MultiPolygon"), "'MultiPolygon'", ""),
    "polygon with a hole": ("west", lambda f: f["geometry"]["coordinates"].append([]), "got", ""),
    "fence line without width": (
        "f0",
        lambda f: f.update(geometry={"type": "LineString", "coordinates": f["geometry"]["coordinates"][0]}),
        "got width_m nothing",
        "",
    ),
    "negative nail height": ("r0n0", lambda f: f["properties"].update(height_m=-1), "got height_m -1", ""),
    "misspelt property": (
        "r0n0",
        lambda f: f["properties"].update(heigth_m=f["properties"].pop("height_m")),
        "got height_m nothing",
        "did you mean 'heigth_m'?",
    ),
    "yaw in degrees": ("r0n0", lambda f: f["properties"].update(yaw_rad=-90), "got yaw_rad -90", ""),
    "equal markers": ("r0n0", lambda f: f["properties"].update(markers=[10, 10]), "got markers [10, 10]", ""),
    "marker out of the dictionary": ("r0n0", lambda f: f["properties"].update(markers=[10, 50]), "got markers", ""),
    "refill point without a yaw": ("shed", lambda f: f["properties"].pop("yaw_rad"), "got yaw_rad nothing", ""),
    "refill point that is a line": ("shed", lambda f: f["geometry"].update(type="LineString"), "a refill has", ""),
    "two starts": (
        "west",
        lambda f: f.update(
            properties={"kind": "start", "id": "s2"}, geometry={"type": "Point", "coordinates": [3.0632, 42.3415]}
        ),
        "2 starts",
        "",
    ),
    "no properties": ("west", lambda f: f.pop("properties"), "got {", ""),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_feature_gets_its_own_error(case, document, problems_of):
    id, breaks, got, suggestion = BROKEN[case]
    breaks(feature(document, id))
    (problem,) = problems_of(document)
    assert got in problem.got
    assert suggestion in problem.suggestion
    assert problem.allowed
    assert problem.path.startswith("features")
    if case not in ("huge integer", "two starts"):
        line = json.dumps(document, indent=1).splitlines()[problem.line - 1]
        assert problem.line > 1 and problem.column > 0 and line.strip()


def test_the_place_is_that_of_the_wrong_value(document, problems_of):
    feature(document, "r0v0")["properties"]["row"] = "r9"
    (problem,) = problems_of(document)
    assert json.dumps(document, indent=1).splitlines()[problem.line - 1][problem.column - 1 :].startswith('"row": "r9"')


def test_places_are_those_of_the_yaml_parser():
    text = '{"a": [1, {"b,": "x:}", "c": []}, [[2], {}]],\n "d": {"e": null}, "f": "\\u00e9\\\\"}\n'
    places = dict(parse_yaml(text, "x").places)
    assert _places(text, places.keys()) == places
    last = max(places, key=lambda key: places[key])
    assert _places(text, {last}) == {last: places[last]}


def test_of_very_many_problems_the_first_are_reported(document, problems_of):
    document["features"] = [1] * 5000
    problems = problems_of(document)
    assert len(problems) == 100
    assert problems[99].path == "features.99" and problems[99].line > 0


@pytest.mark.parametrize("id", ["\ud800", "a\nb", "\x1b[31mred"])
def test_ids_that_cannot_be_shown_are_refused(document, problems_of, id):
    document["features"][0]["properties"]["id"] = id
    assert "printable" in problems_of(document)[0].allowed


@pytest.mark.parametrize("word", PLACES)
@pytest.mark.parametrize("plant", ["r0v0", "r0n0"])
def test_no_plant_is_called_as_a_place_of_dispensers(document, problems_of, plant, word):
    feature(document, plant)["properties"]["id"] = word
    (problem,) = problems_of(document)
    assert problem.got == f"got id {word!r}" and "feeder, hand, lost, stock, dropped" in problem.allowed
    assert problem.file.endswith("site.geojson")
    assert json.dumps(document, indent=1).splitlines()[problem.line - 1].strip() == f'"id": "{word}",'


def test_what_is_no_plant_may_be_called_as_a_place_of_dispensers(document, tmp_path):
    feature(document, "shed")["properties"]["id"] = "feeder"
    (tmp_path / "b.geojson").write_text(json.dumps(document))
    assert load_site(tmp_path / "b.geojson").refills[0].id == "feeder"


@pytest.mark.parametrize("first", range(len(NAMES)))
def test_growers_keep_their_names(tmp_path, first):
    names = NAMES[first : first + 3]
    save_site(with_names(small_site(), names), tmp_path / "a.geojson")
    assert [plant.id for plant in load_site(tmp_path / "a.geojson").plants][: len(names)] == [*names]


def test_pieces_of_a_fence_and_the_start_leave_the_names_of_others_alone(document, tmp_path):
    points = geodetic_from_enu(DATUM, np.array([[0.0, 5.0, 0.0], [4.0, 5.0, 0.0], [4.0, 8.0, 0.0]]))
    line = {"type": "LineString", "coordinates": [[lon, lat] for lat, lon, _ in points]}
    feature(document, "f0").update(geometry=line, properties={"kind": "fence", "id": "f0", "width_m": 0.6})
    feature(document, "west").update(geometry=line, properties={"kind": "fence", "id": "f" * 80, "width_m": 0.6})
    feature(document, "start")["properties"]["id"] = "gate"
    feature(document, "r0v0")["properties"]["id"] = "start"
    feature(document, "r1v0")["properties"]["id"] = "f0#1"
    (tmp_path / "a.geojson").write_text(json.dumps(document))
    site = load_site(tmp_path / "a.geojson")
    assert {fence.id for fence in site.fences} == {"f0", "f0#2", "f" * 80, "f" * 70 + "#1"}
    save_site(site, tmp_path / "b.geojson")
    assert [plant.id for plant in load_site(tmp_path / "b.geojson").plants] == ["start", "r0n0", "f0#1"]


def test_a_marker_belongs_to_one_nail(document, problems_of):
    other = json.loads(json.dumps(feature(document, "r0n0")))
    other["properties"]["id"] = "r0n1"
    document["features"].append(other)
    assert {p.got for p in problems_of(document)} == {
        "marker 10 belongs to two nails",
        "marker 11 belongs to two nails",
    }


def test_all_problems_are_reported_at_once(document, problems_of):
    feature(document, "r0v0")["properties"]["kind"] = "vien"
    feature(document, "r1v0")["properties"]["row"] = "r7"
    feature(document, "r0n0")["properties"]["height_m"] = "high"
    assert len(problems_of(document)) == 3


def test_plants_of_a_broken_row_are_not_blamed(document, problems_of):
    feature(document, "r0")["properties"]["side"] = "top"
    (problem,) = problems_of(document)
    assert "'top'" in problem.got


@pytest.mark.parametrize("missing", ["row", "start"])
def test_rows_and_a_start_are_needed(document, problems_of, missing):
    keep = ("start",) if missing == "row" else ("row",)
    document["features"] = [f for f in document["features"] if f["properties"]["kind"] in keep]
    (problem,) = problems_of(document)
    assert missing in problem.got


@pytest.mark.parametrize(
    ("datum", "path"),
    [([3, 42], "datum"), ({"lat": 42.0}, "datum.lon"), ({"lat": 142.0, "lon": 3.0}, "datum.lat")],
)
def test_a_wrong_datum_is_an_error(document, problems_of, datum, path):
    document["datum"] = datum
    (problem,) = problems_of(document)
    assert problem.path == path


@pytest.mark.parametrize(
    ("text", "got"),
    [
        ('{"type": "FeatureCollection",\n "features": [}', "not JSON"),
        ("", "not JSON"),
        ("[1, 2]", "list"),
        ('{"type": "Feature"}', "'Feature'"),
        ('{"type": "FeatureCollection", "features": 3}', "got 3"),
        ("[" * 100_000, "nested too deeply"),
        ("9" * 5000, "not JSON"),
    ],
)
def test_text_that_is_no_feature_collection_is_refused(problems_of, text, got):
    (problem,) = problems_of(text)
    assert got in problem.got


def test_a_json_error_names_line_and_column(problems_of):
    (problem,) = problems_of('{"type": "FeatureCollection",\n "features": [}')
    assert (problem.line, problem.column) == (2, 15)


def test_files_that_cannot_be_read_are_refused(tmp_path, monkeypatch):
    (tmp_path / "bytes.geojson").write_bytes(b"\xff\xfe\x00{")
    (tmp_path / "large.geojson").write_text(" " * 2000)
    monkeypatch.setattr("grape.site_check.MAX_BYTES", 1000)
    for name, word in (("none.geojson", "cannot be read"), ("bytes.geojson", "UTF-8"), ("large.geojson", "too large")):
        with pytest.raises(FileError, match=word):
            load_site(tmp_path / name)
