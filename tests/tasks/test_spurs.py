"""Deployment poses from clouds of small tube vines, as seen from the robot's side."""

import numpy as np
import pytest

from grape.errors import InvalidInput
from grape.geometry import pose, rotation_from_rpy, transform
from grape.messages import CameraInfo, RgbdImage
from grape.tasks.dispenser.actions.find_deployment_points import unseen_ends
from grape.tasks.dispenser.perception.deployment_pose import DeploymentPose, ScoreOptions, SpurMeasure, score_factors
from grape.tasks.dispenser.perception.depth_view import DepthView
from grape.tasks.dispenser.perception.geodesic import GeodesicOptions, geodesic_candidates
from grape.tasks.dispenser.perception.silhouette import silhouette_candidates
from grape.tasks.dispenser.perception.spur_measure import RefineOptions
from grape.tasks.dispenser.perception.spurs import LIDAR_SPURS, MergeOptions, SpurOptions, extract_poses, merge_poses

UP, TO_ROBOT = np.array([0.0, 0, 1]), np.array([0.0, -1, 0])
EYE = np.array([[0.0, -0.45, 0.85]])
ARM = ((-0.35, 0, 0.75), (0.35, 0, 0.75), 0.018)


def spur(x, y=0.0, tilt=0.0, length=0.10, diameter=0.009, azimuth=0.0, z=0.765):
    """(base, tip, radius) of a spur on the arm, its tilt (deg) from vertical."""
    t = np.radians(tilt)
    way = np.array([np.sin(t) * np.cos(azimuth), np.sin(t) * np.sin(azimuth), np.cos(t)])
    base = np.array([x, y, z])
    return base, base + way * length, diameter / 2


def knob(x, y=0.0):
    return (np.array([x, y, 0.75]), np.array([x, y, 0.785]), 0.012)


def surface(tubes, rng, eye=EYE[0], noise=0.0006, spacing=0.0012):
    """Points on the sides and ends of tubes that `eye` sees, with noise along the view."""
    points, normals = [], []
    for start, end, radius in tubes:
        start, end = np.asarray(start, float), np.asarray(end, float)
        axis = (end - start) / np.linalg.norm(end - start)
        u = np.cross(axis, [0.3, 0.8, 0.52])
        u /= np.linalg.norm(u)
        n = int(2 * np.pi * radius * np.linalg.norm(end - start) / spacing**2) + 50
        angle, s = rng.uniform(0, 2 * np.pi, n), rng.uniform(0, 1, n)
        out = np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * np.cross(axis, u)
        points.append(start + s[:, None] * (end - start) + radius * out)
        normals.append(out)
    points, normals = np.vstack(points), np.vstack(normals)
    ray = points - eye
    distance = np.linalg.norm(ray, axis=1)
    ray /= distance[:, None]
    facing = (normals * ray).sum(1) < -0.15
    points, ray, distance = points[facing], ray[facing], distance[facing]
    cell = np.floor(np.column_stack([ray[:, 0], ray[:, 2]]) / ray[:, 1:2] * 300).astype(int)
    _, group = np.unique(cell, axis=0, return_inverse=True)
    nearest = np.full(group.max() + 1, np.inf)
    np.minimum.at(nearest, group, distance)
    seen = distance < nearest[group] + 0.015
    return points[seen] + ray[seen] * rng.normal(0, noise, seen.sum())[:, None]


def cloud(*spurs, extra=(), seed=0, eye=EYE[0]):
    tubes = [ARM, *spurs, *(knob(s[0][0], s[0][1]) for s in spurs), *extra]
    return surface(tubes, np.random.default_rng(seed), eye)


def assert_pose(found, truth, tip_m=0.006, degrees=5):
    base, tip, _ = truth
    way = (tip - base) / np.linalg.norm(tip - base)
    assert np.linalg.norm(found.tip - tip) < tip_m, (found.tip, tip)
    assert np.degrees(np.arccos(np.clip(found.direction @ way, -1, 1))) < degrees


def test_upright_spurs_are_found_with_tip_direction_and_diameter():
    truths = [spur(-0.2, tilt=10), spur(0.0, tilt=0), spur(0.2, tilt=25, azimuth=2.0)]
    poses = extract_poses(cloud(*truths), EYE)
    assert len(poses) == 3
    for truth in truths:
        found = min(poses, key=lambda p: np.linalg.norm(p.tip - truth[1]))
        assert_pose(found, truth)
        assert found.diameter_m == pytest.approx(2 * truth[2], abs=0.0025)
        assert 0.05 < found.length_m < 0.13 and found.score > 0.6


def test_poses_are_ordered_and_the_score_is_the_product_of_its_factors():
    poses = extract_poses(cloud(spur(-0.2, tilt=48), spur(0.0), spur(0.2, length=0.055)), EYE)
    scores = [p.score for p in poses]
    assert len(poses) >= 2 and scores == sorted(scores, reverse=True)
    for p in poses:
        assert p.score == pytest.approx(np.prod(list(p.factors.values())))
    assert abs(poses[0].tip[0]) < 0.01


@pytest.mark.parametrize("tilt", [75, 95])
def test_a_spur_that_lies_down_is_no_deployment_pose(tilt):
    assert extract_poses(cloud(spur(0.0, tilt=tilt, azimuth=0.0)), EYE) == ()


def test_a_bare_arm_has_no_deployment_pose():
    assert extract_poses(surface([ARM], np.random.default_rng(0)), EYE) == ()


def test_a_stalk_that_stands_on_nothing_loses_to_a_spur():
    weed = (np.array([0.15, -0.05, 0.60]), np.array([0.15, -0.05, 0.90]), 0.003)
    poses = extract_poses(cloud(spur(-0.1), extra=[weed]), EYE)
    assert abs(poses[0].tip[0] + 0.1) < 0.01
    assert all(p.score < 0.5 for p in poses[1:])


def test_a_cane_much_longer_than_a_spur_loses_to_a_spur():
    poses = extract_poses(cloud(spur(-0.15), spur(0.15, length=0.35, diameter=0.006)), EYE)
    assert poses[0].tip[0] < 0


def test_a_branch_in_the_way_of_the_hand_costs_score():
    free = extract_poses(cloud(spur(0.0)), EYE)[0]
    bar = (np.array([-0.1, -0.06, 0.95]), np.array([0.1, -0.06, 0.95]), 0.012)
    blocked = min(extract_poses(cloud(spur(0.0), extra=[bar]), EYE), key=lambda p: abs(p.tip[0]))
    assert blocked.factors["corridor"] < 0.8 < free.factors["corridor"]


def test_reach_orders_poses_and_can_forbid_them():
    points = cloud(spur(-0.2), spur(0.2))
    poses = extract_poses(points, EYE, reach=lambda tip: 1.0 if tip[0] > 0 else 0.0)
    assert len(poses) == 1 and poses[0].tip[0] > 0


def test_any_frame_works_when_up_and_origins_are_given_in_it():
    truth = spur(0.05, tilt=15)
    points = cloud(truth, spur(-0.2))
    T = pose(rotation_from_rpy(0.5, -0.8, 2.0), (3.0, -2.0, 7.0))
    poses = extract_poses(transform(T, points), transform(T, EYE), up=T[:3, :3] @ UP)
    tips = [transform(np.linalg.inv(T), p.tip) for p in poses]
    assert min(np.linalg.norm(t - truth[1]) for t in tips) < 0.006


def test_progress_rises_to_100_even_without_points():
    for points in (cloud(spur(0.0)), np.empty((0, 3))):
        heard = []
        extract_poses(points, EYE, progress=heard.append)
        assert heard[0] == 0 and heard[-1] == 100 and heard == sorted(heard)


@pytest.mark.parametrize("generator", ["geodesic", "silhouette"])
def test_each_generator_alone_finds_a_spur(generator):
    truth = spur(0.05, tilt=10)
    (found,) = extract_poses(cloud(truth), EYE, SpurOptions(generators=(generator,)))
    assert_pose(found, truth)


def test_generators_propose_ends_that_point_up():
    points = cloud(spur(0.05, tilt=10))
    for candidates in (geodesic_candidates(points[::6], UP), silhouette_candidates(points, UP, TO_ROBOT)):
        assert candidates.shape[1] == 6 and len(candidates) >= 1
        np.testing.assert_allclose(np.linalg.norm(candidates[:, 3:], axis=1), 1.0)
        assert (candidates[:, 5] > 0).all()


def test_generators_have_nothing_to_say_about_almost_no_points():
    few = np.random.default_rng(1).uniform(0, 1, (8, 3))
    assert geodesic_candidates(few, UP).shape == (0, 6)
    assert silhouette_candidates(few, UP, TO_ROBOT).shape == (0, 6)
    assert geodesic_candidates(few * 100, UP, GeodesicOptions(neighbours=3)).shape == (0, 6)
    assert extract_poses(few, EYE) == ()


def test_poses_of_several_views_merge_to_their_medians():
    truths = [spur(-0.1, tilt=10), spur(0.1, tilt=20)]
    views = []
    rng = np.random.default_rng(3)
    for k, x in enumerate((-0.2, 0.0, 0.2)):
        eye = np.array([x, -0.45, 0.85])
        shift = rng.normal(0, 0.003, 3)  # error of the arm
        views.append(extract_poses(cloud(*truths, seed=k, eye=eye) + shift, eye[None] + shift))
    merged = merge_poses(views)
    assert len(merged) == 2
    for truth in truths:
        found = min(merged, key=lambda p: np.linalg.norm(p.tip - truth[1]))
        assert_pose(found, truth, tip_m=0.008)
        assert found.frames == 3 and found.factors["support"] == 1.0


def test_a_sparse_noisy_lidar_cloud_still_shows_its_spur():
    truth = spur(0.05, tilt=10)
    tubes = [(start, end, radius + 0.0015) for start, end, radius in (ARM, truth, knob(0.05))]  # the beam's spot
    points = surface(tubes, np.random.default_rng(5), noise=0.003, spacing=0.0022)
    poses = extract_poses(points, EYE, LIDAR_SPURS)
    assert len(poses) == 1
    assert_pose(poses[0], truth, tip_m=0.012, degrees=10)


def a_pose(tip=(0, 0, 0.9), score=0.8, direction=(0, 0, 1)):
    tip = np.array(tip, float)
    return DeploymentPose(
        tip=tip, base=tip - 0.1 * np.array(direction), direction=np.array(direction), diameter_m=0.009, length_m=0.1,
        score=score, factors={"all": score},
    )  # fmt: skip


def test_what_one_of_many_views_saw_loses_and_may_drop_out():
    seen, once = a_pose(), a_pose((0.3, 0, 0.9), score=0.85)
    merged = merge_poses([[seen, once], [seen], [seen]])
    assert [p.frames for p in merged] == [3, 1]
    assert merged[1].score == pytest.approx(0.85 * 0.7)
    assert len(merge_poses([[seen, once], [seen], [seen]], MergeOptions(min_score=0.6))) == 1


def test_a_spur_that_few_of_the_views_that_should_have_shown_it_found_drops_out():
    seen, once = a_pose(), a_pose((0.3, 0, 0.9))
    views = [[seen, once], [seen], [seen], [seen]]
    alone = merge_poses(views, shows=[lambda pose: 1.0, *[lambda pose: float(pose.tip[0] < 0.2)] * 3])
    assert [p.frames for p in alone] == [4, 1], "no other view looked there"
    assert alone[1].factors["agreement"] == 1.0
    doubtful = merge_poses(views, shows=[lambda pose: 1.0, *[lambda pose: 0.2] * 3])
    assert 0 < doubtful[1].factors["agreement"] < 1.0 and doubtful[1].score < alone[1].score
    assert [p.frames for p in merge_poses(views, shows=[lambda pose: 1.0] * 4)] == [4]


def test_a_depth_frame_tells_what_it_should_have_shown():
    K = np.array([[466.0, 0, 319.5], [0, 466.0, 239.5], [0, 0, 1]])
    T = pose(np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), (0.0, -0.5, 0.9))  # looks along y
    info = CameraInfo(stamp=0.0, width=640, height=480, K=K)

    def view(depth):
        image = RgbdImage(stamp=0.0, bgr=np.zeros((480, 640, 3), np.uint8), depth=np.float32(depth), info=info)
        return DepthView(image=image, T_base_camera=T)

    plain = view(np.full((480, 640), 0.6))
    assert plain.shows(a_pose()) == 1.0
    assert plain.shows(a_pose((0.33, 0, 0.9))) == 0.0, "at the picture's edge"
    assert plain.shows(a_pose((0.0, -0.8, 0.9))) == 0.0, "behind the camera"
    assert view(np.full((480, 640), 0.4)).shows(a_pose()) == 0.5, "something is in front"
    assert view(np.zeros((480, 640))).shows(a_pose()) == 0.5, "nothing was measured"


def test_crossing_spurs_with_near_tips_stay_apart_in_one_view_only_the_better_remains():
    crossing = a_pose((0.02, 0, 0.9), 0.7, (0.8, 0, 0.6))
    assert len(merge_poses([[a_pose()], [crossing]])) == 1
    far = a_pose((0.06, 0, 0.9), 0.7, (0.8, 0, 0.6))
    assert len(merge_poses([[a_pose()], [far]])) == 2


def test_no_views_have_no_poses():
    assert merge_poses([]) == () and merge_poses([(), ()]) == ()


def measure(**changes):
    values = dict(
        tip=np.array([0, 0, 0.9]), base=np.array([0, 0, 0.8]), direction=UP, diameter_m=0.009, own=500, beyond=0,
        below=50, beside=0, corridor=0, thickness_m=0.03, behind_m=0.0,
    )  # fmt: skip
    return SpurMeasure(**{**values, **changes})


@pytest.mark.parametrize(
    ("factor", "changes"),
    [
        ("length", {"base": np.array([0, 0, 0.88])}),
        ("length", {"base": np.array([0, 0, 0.60])}),
        ("tilt", {"direction": np.array([0.8, 0, 0.6])}),
        ("diameter", {"diameter_m": 0.004}),
        ("diameter", {"diameter_m": 0.025}),
        ("free_end", {"beyond": 200}),
        ("corridor", {"corridor": 600}),
        ("crowd", {"beside": 800}),
        ("attached", {"below": 0}),
        ("stands_on", {"thickness_m": 0.008}),
        ("near_side", {"behind_m": 0.3}),
        ("points", {"own": 10}),
    ],
)
def test_each_gate_takes_away_for_its_own_reason(factor, changes):
    good = score_factors(measure(), UP, 1.0, ScoreOptions())
    bad = score_factors(measure(**changes), UP, 1.0, ScoreOptions())
    assert all(v == pytest.approx(1.0) for v in good.values())
    assert bad[factor] < 0.8


def test_the_height_gate_is_optional():
    options = ScoreOptions(height_m=(1.0, 1.1, 1.4, 1.5))
    assert score_factors(measure(), UP, 1.0, options)["height"] == 0.0
    assert "height" not in score_factors(measure(), UP, 1.0, ScoreOptions())


def test_poses_are_frozen():
    found = a_pose()
    with pytest.raises(ValueError, match="read-only"):
        found.tip[0] = 1.0
    with pytest.raises(TypeError):
        found.factors["all"] = 2.0
    assert found.tilt(np.array([1.0, 0, 0])) == pytest.approx(np.pi / 2)


def test_inputs_that_make_no_sense_are_refused():
    points = np.random.default_rng(1).uniform(0, 0.1, (500, 3))
    with pytest.raises(InvalidInput, match="points"):
        extract_poses(np.zeros((4, 2)), EYE)
    with pytest.raises(InvalidInput, match="points"):
        extract_poses(np.full((4, 3), np.nan), EYE)
    with pytest.raises(InvalidInput, match="origin"):
        extract_poses(points, np.empty((0, 3)))
    with pytest.raises(InvalidInput, match="up"):
        extract_poses(points, EYE, up=(0, 0, 0))
    with pytest.raises(InvalidInput, match="generators"):
        SpurOptions(generators=("magic",))
    with pytest.raises(InvalidInput, match="positive"):
        RefineOptions(iterations=0)
    with pytest.raises(InvalidInput, match="rise"):
        ScoreOptions(tilt_deg=(60, 40))
    with pytest.raises(InvalidInput, match="positive"):
        MergeOptions(group_m=0)
    with pytest.raises(InvalidInput, match="direction"):
        a_pose(direction=(0, 0, 0))


def test_a_spur_that_the_picture_cuts_off_goes_on_as_far_as_nobody_has_looked():
    K = np.array([[466.0, 0, 319.5], [0, 466.0, 239.5], [0, 0, 1]])
    info = CameraInfo(stamp=0.0, frame_id="camera_optical", width=640, height=480, K=K)
    depth = np.full((480, 640), 1.5, np.float32)
    depth[:, 400:] = 0.3  # something near hides the right of the picture
    image = RgbdImage(
        stamp=0.0, frame_id="camera_optical", bgr=np.zeros((480, 640, 3), np.uint8), depth=depth, info=info
    )
    view = DepthView(image=image, T_base_camera=np.eye(4))
    row = np.array([[0.0, -0.1, 0.6], [0.0, -0.4, 0.6], [0.2, 0.0, 0.6], [0.0, 0.0, 0.1], [0.0, 0.0, -0.6]])
    assert view.looked_at(row).tolist() == [True, False, False, False, False]
    up = np.array([0.0, -1.0, 0.0])
    kind = {"direction": up, "diameter_m": 0.01, "length_m": 0.1, "score": 1.0, "factors": {}}
    whole = DeploymentPose(tip=np.array([0.0, -0.1, 0.6]), base=np.array([0.0, 0.0, 0.6]), **kind)
    cut = DeploymentPose(tip=np.array([0.0, -0.30, 0.6]), base=np.array([0.0, -0.2, 0.6]), **kind)
    assert len(unseen_ends(whole, [view])) == 0
    beyond = unseen_ends(cut, [view])
    assert len(beyond) == 12 and beyond[-1] == pytest.approx([0.0, -0.42, 0.6])
