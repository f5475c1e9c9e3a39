"""Mission files: names, worlds, sites and plants are checked together, and a kept mission repeats the run."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from grape.actions.core import Context, Feedback, NoResult, action
from grape.bt import load_tree
from grape.errors import FileError, InvalidInput
from grape.mapping import save_map
from grape.mission.catalog import nodes
from grape.mission.file import Mission, load_mission
from grape.mission.launch import identity, make_folder, planned_faults, run_mission, write_inputs
from grape.sim.faults import FreezeSensor
from grape.site import save_site


def problems_of(name: str, overrides: list[str] | None = None, world: Path | None = None) -> list[str]:
    with pytest.raises(FileError) as caught:
        load_mission(name, overrides or [], world)
    return [str(problem) for problem in caught.value.problems]


def test_the_default_mission_serves_two_nails_and_two_vines_in_two_rows(mission: Mission) -> None:
    assert sorted(plant.mode for plant in mission.plants) == ["nail", "nail", "plant", "plant"]
    assert {mission.site.plant(plant.plant).row for plant in mission.plants} == {"r0", "r1"}
    assert mission.file.dispensers == 8


def test_auto_is_the_nail_on_a_nail_and_the_closed_loop_on_a_vine() -> None:
    plants = "plants=[{plant: r0v1, mode: auto}, {plant: r0n0}, {plant: r1v1, mode: plant_open_loop}]"
    mission = load_mission("dispenser_deployment", [plants])
    assert [plant.mode for plant in mission.plants] == ["plant", "nail", "plant_open_loop"]


def test_the_seed_is_also_the_worlds_unless_the_world_has_its_own() -> None:
    assert load_mission("dispenser_deployment", ["seed=7"]).world.seed == 7
    assert load_mission("dispenser_deployment", ["seed=7", "world.seed=3"]).world.seed == 3


def test_overrides_reach_mission_world_and_action_parameters() -> None:
    overrides = ["world.style=gobelet", "world.slope=0.15", "time_limit_s=60", "actions.ScanVine.speed=0.1"]
    mission = load_mission("dispenser_deployment", overrides)
    assert (mission.world.style, mission.world.slope, mission.file.time_limit_s) == ("gobelet", 0.15, 60)
    assert mission.actions == {"ScanVine": {"speed": 0.1}}


def test_walkers_are_checked_and_kept_and_their_absence_leaves_no_trace(mission: Mission, tmp_path: Path) -> None:
    walkers = "world.walkers=[{id: anna, path: [[2, -4], [2.5, 4]], start_s: 12}, {id: rex, kind: dog, path: [[0, 1]]}]"
    walked = load_mission("dispenser_deployment", [walkers])
    assert [(w.id, w.kind, w.start_s) for w in walked.world.walkers] == [("anna", "person", 12.0), ("rex", "dog", 0.0)]
    assert walked.world.walkers[0].path == ((2.0, -4.0), (2.5, 4.0))
    write_inputs(walked, tmp_path)
    assert load_mission(str(tmp_path / "mission.yaml")).world == walked.world
    assert "walkers" not in mission.resolved()["world"]


@pytest.mark.parametrize(
    ("walker", "expected"),
    [
        ("{id: a, path: [[0, 0]], kind: cow}", "world.walkers.0.kind"),
        ("{id: a, path: []}", "world.walkers.0.path"),
        ("{id: a, path: [[0, 0]], pace: 2}", "world.walkers.0.pace"),
        ("{id: a, path: [[0, 0]]}, {id: a, path: [[1, 0]]}", "id of its own"),
    ],
)
def test_a_wrong_walker_is_named_with_its_place(walker: str, expected: str) -> None:
    (problem,) = problems_of("dispenser_deployment", [f"world.walkers=[{walker}]"])
    assert expected in problem


def test_faults_are_kept_and_become_what_the_simulation_plans(tmp_path: Path) -> None:
    faults = "faults=[{at_s: 40, for_s: 60, silent: front_laser}, {at_s: 9.5, for_s: 8, gnss_jump: [0.5, -0.1]}]"
    mission = load_mission("dispenser_deployment", [faults])
    write_inputs(mission, tmp_path)
    assert load_mission(str(tmp_path / "mission.yaml")).file.faults == mission.file.faults
    (begin, silent), (end, loud), (at, jump) = planned_faults(mission)
    assert (begin, silent) == (40, FreezeSensor(name="front_laser"))
    assert (end, loud) == (100, FreezeSensor(name="front_laser", frozen=False))
    assert (at, jump.duration_s, jump.wrong_fix, jump.bias.tolist()) == (9.5, 8, True, [0.5, -0.1, 0.0])


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        ("{at_s: 1, for_s: 1}", "faults.0: got both or neither; allowed: either silent or gnss_jump"),
        ("{at_s: 1, for_s: 1, silent: gnss, gnss_jump: [1, 0]}", "got both or neither"),
        ("{at_s: 1, for_s: 1, silent: front_lasr}", "did you mean 'front_laser'?"),
        ("{at_s: 1, for_s: 1, silent: camera_optical}", "faults.0.silent: got 'camera_optical'"),
        ("{at_s: 1, for_s: 0, silent: gnss}", "greater than 0"),
        (
            "{at_s: 1, for_s: 9, silent: gnss}, {at_s: 8, for_s: 9, silent: gnss}",
            "faults.1.at_s: gnss is silent already",
        ),
        ("{at_s: 1, for_s: 1, gnss_jump: [500, 0]}", "less than or equal to 100"),
    ],
)
def test_a_wrong_fault_is_named_with_its_place(fault: str, expected: str) -> None:
    (problem,) = problems_of("dispenser_deployment", [f"faults=[{fault}]"])
    assert expected in problem


def test_a_map_is_the_sites_or_a_file_that_the_run_folder_keeps(tmp_path: Path) -> None:
    of_site = load_mission("dispenser_deployment", ["map=site"])
    write_inputs(of_site, tmp_path)
    assert load_mission(str(tmp_path / "mission.yaml")).map.occupied().sum() == of_site.map.occupied().sum() > 0
    assert not (tmp_path / "map.yaml").exists()
    save_map(of_site.map, tmp_path / "survey.yaml")
    (tmp_path / "mine.yaml").write_text("name: mine\nmap: survey.yaml\n", encoding="utf-8")
    mine, run = load_mission(str(tmp_path / "mine.yaml")), tmp_path / "run"
    run.mkdir()
    write_inputs(mine, run)
    np.testing.assert_array_equal(load_mission(str(run / "mission.yaml")).map.occupancy, of_site.map.occupancy)
    assert load_mission("dispenser_deployment").map is None
    before, picture = identity(run), run / "map.pgm"
    picture.write_bytes(picture.read_bytes()[:-1] + b"\x01")
    assert identity(run) != before, "another map is another input"


def test_what_is_wrong_with_a_map_is_told(tmp_path: Path) -> None:
    (problem,) = problems_of("dispenser_deployment", ["map=nowhere.yaml"])
    assert "map: got 'nowhere.yaml'; allowed: site, or the path of a map's YAML file" in problem
    (tmp_path / "survey.yaml").write_text("image: none.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n", encoding="utf-8")
    (problem,) = problems_of("dispenser_deployment", [f"map={tmp_path / 'survey.yaml'}"])
    assert "none.pgm" in problem


def test_defaults_of_goals_get_the_types_of_their_fields(tmp_path: Path) -> None:
    overrides = ["actions.FindDeploymentPoints={height_m: [0.3, 1], pitches: [1]}", "actions.Unwind={}"]
    mission = load_mission("dispenser_deployment", overrides)
    assert mission.actions == {"FindDeploymentPoints": {"height_m": (0.3, 1.0), "pitches": (1.0,)}, "Unwind": {}}
    write_inputs(mission, tmp_path)
    assert load_mission(str(tmp_path / "mission.yaml")).actions == mission.actions


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("robot=husky_jaco", "robot: got 'husky_jaco'; allowed: husky_jaco2, robi_jaco2; did you mean 'husky_jaco2'?"),
        ("task=dispensers", "did you mean 'dispenser'?"),
        ("tree=dispenser_deploy", "did you mean 'dispenser_deployment'?"),
        ("world.type=vinyard", "did you mean 'vineyard'?"),
        ("world.stlye=cordon", "world.stlye: unknown key"),
        ("world.style=gobelt", "allowed: cordon, gobelet; did you mean 'gobelet'?"),
        ("world.rows=0", "greater than or equal to 1"),
        ("plants.0.plant=r0v99", "the site has no 'r0v99'"),
        ("plants.0.mode=nail", "got 'nail' for r0v1, a vine; allowed: plant, plant_open_loop"),
        ("plants.1.plant=r0v1", "'r0v1' is listed twice"),
        ("plants=[]", "the list is empty"),
        ("select.nails=1", "both plants and select are given"),
        ("dispensers=9", "less than or equal to 8"),
        ("refill.fill=9", "less than or equal to 8"),
        ("refill.stok=1", "did you mean 'stock'?"),
        ("refill.after_s=[9, 3]", "refill.after_s: got [9.0, 3.0]; allowed: the shortest time, then the longest"),
        ("time_limit_s=0", "greater than 0"),
        ("arm_errors=-1", "greater than or equal to 0"),
        ("world.glare=2", "less than or equal to 1"),
        ("sede=3", "did you mean 'seed'?"),
        ("actions.ScanVin.speed=1", "actions.ScanVin: unknown node; allowed: ApproachNail, "),
        ("actions.ScanVin.speed=1", "did you mean 'ScanVine'?"),
        ("actions.ScanVine.sped=1", "actions.ScanVine.sped: unknown key; allowed: half_length_m, speed, "),
        ("actions.ScanVine.sped=1", "did you mean 'speed'?"),
        ("actions.ScanVine.speed=fast", "actions.ScanVine.speed: got 'fast'; allowed: number"),
        ("actions.ScanVine.images=1.5", "actions.ScanVine.images: got 1.5; allowed: "),
        ("actions.ScanVine.plant=r0v1", "actions.ScanVine.plant: the tree always gives this port; allowed: half_"),
        ("actions.ScanVine.scan=1", "actions.ScanVine.scan: unknown key"),
        ("actions.FindDeploymentPoints.height_m=[1]", "actions.FindDeploymentPoints.height_m.1: is missing"),
        ("actions.DriveToPose.speed=0.5", "actions.DriveToPose: no node of dispenser_deployment.xml; allowed: "),
        (
            "actions.WaitForLocalization.timeout_s=9",
            "dispenser_deployment.xml sets this port at every WaitForLocalization, and the tree wins",
        ),
        ("actions.ScanVine=fast", "actions.ScanVine: got 'fast'"),
        ("actions.DriveToPlant.planner=ted", "--set: actions.DriveToPlant.planner: grape.local_planners: 'ted' is not"),
        ("actions.DriveToPlant.planner=ted", "did you mean 'teb'?"),
        ("actions.DriveToRefill.global_planner=leg", "did you mean 'legs'?"),
        ("site=nowhere.geojson", "site: got 'nowhere.geojson'"),
    ],
)
def test_each_wrong_value_gets_its_problem(override: str, expected: str) -> None:
    (first, *_) = [problem for problem in problems_of("dispenser_deployment", [override]) if expected in problem]
    assert first.startswith("--set: ")


def test_independent_problems_are_listed_together() -> None:
    assert (
        len(problems_of("dispenser_deployment", ["robot=x", "tree=y", "plants.0.plant=z", "plants.1.mode=plant"])) == 4
    )


def test_problems_in_the_file_name_line_and_column(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("name: mine\nplants:\n  - {plant: r0v77, mode: plant}\n")
    (problem,) = problems_of(str(path))
    assert problem.startswith(f"{path}:3:6: plants.0.plant: the site has no 'r0v77'")


def test_problems_of_goal_defaults_name_line_and_column(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("name: mine\nactions:\n  ScanVine:\n    speed: fast\n  Scan: {}\n")
    first, second = problems_of(str(path))
    assert first.startswith(f"{path}:4:5: actions.ScanVine.speed: got 'fast'")
    assert second.startswith(f"{path}:5:3: actions.Scan: unknown node")


@dataclass(frozen=True, kw_only=True)
class CreepGoal:
    speed: float = 0.1
    cloud: np.ndarray | None = None

    def __post_init__(self) -> None:
        if self.speed > 0.3:
            raise InvalidInput(f"speed must be at most 0.3 m/s, got {self.speed}")


def test_goal_defaults_pass_the_checks_of_the_goal(monkeypatch: pytest.MonkeyPatch) -> None:
    @action("Creep")
    def creep(goal: CreepGoal, ctx: Context) -> Generator[Feedback, None, NoResult]:
        """Creeps."""
        yield Feedback()
        return NoResult()

    monkeypatch.setattr("grape.mission.goal_defaults.nodes", lambda task: {"Creep": creep})
    assert load_mission("dispenser_deployment", ["actions.Creep.speed=0.2"]).actions == {"Creep": {"speed": 0.2}}
    (problem,) = problems_of("dispenser_deployment", ["actions.Creep.speed=0.5"])
    assert problem == "--set: actions.Creep: the goal is refused: speed must be at most 0.3 m/s, got 0.5"
    (problem,) = problems_of("dispenser_deployment", ["actions.Creep.cloud=1"])
    assert "actions.Creep.cloud: unknown key; allowed: speed" in problem, "a file cannot hold an array"


def test_an_unknown_mission_gets_a_suggestion() -> None:
    (problem,) = problems_of("dispenser_deploymnt")
    assert "did you mean 'dispenser_deployment'?" in problem


def test_plants_can_be_chosen_by_number() -> None:
    mission = load_mission("dispenser_deployment", ["plants=null", "select={nails: 1, vines: 3}"])
    assert sorted(plant.mode for plant in mission.plants) == ["nail", "plant", "plant", "plant"]
    assert len({plant.plant for plant in mission.plants}) == 4
    assert "at most" in problems_of("dispenser_deployment", ["plants=null", "select.nails=50"])[0]
    assert "no plant is selected" in problems_of("dispenser_deployment", ["plants=null", "select={}"])[0]


def test_a_world_file_replaces_the_world_and_its_problems_point_into_it(tmp_path: Path) -> None:
    path = tmp_path / "world.yaml"
    path.write_text("type: vineyard\nvines_per_row: 5\n")
    assert load_mission("dispenser_deployment", world=path).world.vines_per_row == 5
    path.write_text("type: vineyard\nrow_spacing: 9\n")
    assert problems_of("dispenser_deployment", world=path) == [
        f"{path}:2:1: world.row_spacing: got 9; allowed: less than or equal to 6"
    ]


def test_a_surveyed_site_replaces_the_generated_one(mission: Mission, tmp_path: Path) -> None:
    save_site(mission.site, tmp_path / "site.geojson")
    surveyed = load_mission("dispenser_deployment", world=tmp_path / "site.geojson")
    assert surveyed.surveyed
    assert [plant.id for plant in surveyed.site.plants] == [plant.id for plant in mission.site.plants]


def test_the_kept_mission_is_the_same_mission(tmp_path: Path) -> None:
    mission = load_mission("dispenser_deployment", ["seed=5", "world.style=gobelet", "plants=null", "select.vines=2"])
    write_inputs(mission, tmp_path)
    again = load_mission(str(tmp_path / "mission.yaml"))
    assert (again.plants, again.seed, again.world) == (mission.plants, 5, mission.world)
    assert again.tree == tmp_path / "tree.xml"


def test_a_kept_tree_brings_along_the_trees_that_it_includes(mission: Mission, tmp_path: Path) -> None:
    mine, run, other = tmp_path / "mine", tmp_path / "run", tmp_path / "other"
    for folder in (mine / "parts", run, other):
        folder.mkdir(parents=True)
    base, library = mission.tree.read_text(), nodes(mission.file.task)
    main = load_tree(mission.tree, library).name
    (mine / "parts" / "base.xml").write_text(base)
    (mine / "tree.xml").write_text(
        '<root BTCPP_format="4" main_tree_to_execute="Mine"><include path="parts/base.xml"/>'
        f'<BehaviorTree ID="Mine"><SubTree ID="{main}"/></BehaviorTree></root>'
    )
    (mine / "mission.yaml").write_text("name: mine\ntree: tree.xml\n")
    including = load_mission(str(mine / "mission.yaml"))
    before = load_tree(including.tree, library)
    write_inputs(including, run)
    (mine / "parts" / "base.xml").write_text(
        base.replace("</root>", '<BehaviorTree ID="B"><Retract/></BehaviorTree></root>')
    )
    write_inputs(including, other)
    assert identity(run) != identity(other), "another included tree is another input"
    shutil.rmtree(mine)
    after = load_tree(load_mission(str(run / "mission.yaml")).tree, library)
    assert [node.path for node in after.root.walk()] == [node.path for node in before.root.walk()]


def test_a_kept_tree_without_includes_is_the_same_file(mission: Mission, tmp_path: Path) -> None:
    source = mission.tree.read_bytes().replace(b"\n", b"\r\n")
    (tmp_path / "mine.xml").write_bytes(source)
    write_inputs(load_mission("dispenser_deployment", [f"tree={tmp_path / 'mine.xml'}"]), tmp_path)
    assert (tmp_path / "tree.xml").read_bytes() == source


def test_a_kept_surveyed_mission_brings_its_site_along(mission: Mission, tmp_path: Path) -> None:
    save_site(mission.site, tmp_path / "mine.geojson")
    run = tmp_path / "run"
    run.mkdir()
    write_inputs(load_mission("dispenser_deployment", world=tmp_path / "mine.geojson"), run)
    (tmp_path / "mine.geojson").unlink()
    assert load_mission(str(run / "mission.yaml")).surveyed


def test_run_folders_are_numbered_and_never_reused(
    mission: Mission, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names = [make_folder(None, mission).name for _ in range(2)]
    assert names == ["dispenser_deployment-seed0-1", "dispenser_deployment-seed0-2"]
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").touch()
    with pytest.raises(ValueError, match="not empty"):
        make_folder(tmp_path / "full", mission)


def test_a_used_run_folder_is_refused_before_the_world_is_built(
    mission: Mission, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr("grape.mission.launch.nodes", lambda task: pytest.fail("work began"))
    for out in (tmp_path, tmp_path / "file"):
        with pytest.raises(ValueError, match="name a new folder"):
            run_mission(mission, out)


def test_what_the_plants_need_beyond_the_feeder_is_ready_for_a_refill() -> None:
    def stock(*overrides: str) -> int:
        return load_mission("dispenser_deployment", overrides).stock

    assert (stock(), stock("dispensers=1"), stock("dispensers=0")) == (0, 3, 4)
    assert stock("refill.stock=12") == 12 and stock("dispensers=1", "refill.stock=0") == 0


def test_a_stock_needs_a_refill_point(mission: Mission, tmp_path: Path) -> None:
    path = tmp_path / "site.geojson"
    save_site(dataclasses.replace(mission.site, refills=()), path)
    assert load_mission("dispenser_deployment", ["dispensers=1"], path).stock == 0
    (problem,) = problems_of("dispenser_deployment", ["refill.stock=3"], path)
    assert "refill.stock: got 3, but the site has no refill point; allowed: 0, or a feature of kind refill" in problem
