"""A robot's models as actions use them, built once from its description and its MJCF."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from grape.errors import InvalidInput
from grape.geometry import transform
from grape.kinematics import ArmModel, HandModel, read_body_pose, read_chain, read_shapes
from grape.messages import Array
from grape.planning import JointPlanner, LinkCapsule, PlannerOptions, SphereModel, StaticBox, build_sphere_model

_LOCALIZED_BY = ("imu_link", "gnss_link")  # mounts that every mission's filter is made with
_FINGER_RADIUS_M = 0.016
_LOOP_HALF_LENGTH_M = 0.065
_LOOP_HALF_WIDTH_M = 0.022
_LOOP_RADIUS_M = 0.010


@dataclass(frozen=True, kw_only=True, eq=False)
class Robot:
    """Description and models of one robot; every pose and collision shape is given in base_link.

    Attributes:
        description: `grape.robots.RobotDescription`.
        arm: kinematics between the arm's base frame and the hand.
        hand: where the nails are in the hand, by finger angle.
        body: collision spheres of the arm with closed fingers, and the boxes of the base.
        loaded_body: the same with fingers spread and a dispenser on the nails.
        planner: joint-space planner with the arm's limits.
    """

    description: Any
    arm: ArmModel
    hand: HandModel
    body: SphereModel
    loaded_body: SphereModel
    planner: JointPlanner

    def hand_pose(self, q: Array) -> Array:
        """`T_base_hand` (4, 4) in base_link for joint angles q (n,) rad."""
        return self.description.arm.T_base_link_arm_base @ self.arm.fk(q)

    def in_arm_base(self, T_base_hand: Array) -> Array:
        """A hand pose of base_link in the arm's base frame, as the inverse kinematics take it."""
        return np.linalg.inv(self.description.arm.T_base_link_arm_base) @ T_base_hand


def build_robot(description: Any) -> Robot:
    """Reads kinematics and collision shapes of a robot from its MJCF.

    Args:
        description: `grape.robots.RobotDescription`.

    Raises:
        InvalidInput: a mount is missing, the MJCF lacks the arm's chain or a shape is of an unknown kind.
    """
    _check_mounts(description)
    arm = ArmModel.from_mjcf(description.mjcf, description.arm.base_frame, description.arm.tip_frame)
    hand = HandModel(description.gripper)
    body, spread = (
        _sphere_model(description, hand, angle)
        for angle in (description.gripper.closed_angle, description.gripper.open_angle)
    )
    limits = description.arm
    return Robot(
        description=description,
        arm=arm,
        hand=hand,
        body=body,
        loaded_body=spread.holding(_held_loop(description, hand, len(limits.joints)), ("link_2", "link_3")),
        planner=JointPlanner(
            limits.position_min,
            limits.position_max,
            limits.set_point_max,
            PlannerOptions(cable_budget_rad=limits.cable_turns),
        ),
    )


def _check_mounts(description: Any) -> None:
    on_base = [name for name, mount in description.mounts.items() if mount.parent == "base_link"]
    for name in _LOCALIZED_BY:
        if name not in on_base:
            known = ", ".join(on_base) or "none"
            raise InvalidInput(f"{description.name} needs a mount {name} on base_link; there are {known}")


def _sphere_model(description: Any, hand: HandModel, finger_angle: float) -> SphereModel:
    arm = description.arm
    chain = read_chain(description.mjcf, arm.base_frame, arm.tip_frame)
    placements = np.array([link.T_parent_link for link in chain])
    placements[0] = arm.T_base_link_arm_base @ placements[0]
    joint_of = {link.name: i + 1 for i, link in enumerate(chain)}
    capsules: list[LinkCapsule] = []
    boxes: list[StaticBox] = []
    for shape in read_shapes(description.mjcf, description.collision_group):
        if shape.body in joint_of:
            capsules.append(_capsule(shape.name, joint_of[shape.body], shape.start, shape.end, shape.radius))
        elif shape.body.startswith("wrist_"):
            T_hand_body = read_body_pose(description.mjcf, shape.body, arm.tip_frame)
            ends = transform(T_hand_body, np.array([shape.start, shape.end]))
            capsules.append(_capsule(shape.name, len(chain), ends[0], ends[1], shape.radius))
        elif not shape.body.startswith(("finger_", "nail_", "wheel_")):
            boxes.append(_box(description, shape))
    capsules += _fingers(description, hand, len(chain), finger_angle)
    return build_sphere_model(
        placements=placements, capsules=capsules, link_pairs=_link_pairs([c.link for c in capsules]), boxes=boxes
    )


def _capsule(name: str, joint: int, start: Array, end: Array, radius: float) -> LinkCapsule:
    p0, p1 = (tuple(float(v) for v in p) for p in (start, end))
    return LinkCapsule(link=name, joint=joint, p0=p0, p1=p1, radius=radius)  # type: ignore[arg-type]


def _box(description: Any, shape: Any) -> StaticBox:
    """A shape of the base as a box along the axes of base_link."""
    T = read_body_pose(description.mjcf, shape.body, "base_link") if shape.body != "base_link" else np.eye(4)
    if shape.kind == "box":
        corners = np.array(np.meshgrid(*([-h, h] for h in shape.half_size))).reshape(3, -1).T
        points, grow = transform(T @ shape.T_body_shape, corners), 0.0
    else:
        points, grow = transform(T, np.array([shape.start, shape.end])), shape.radius
    low, high = points.min(axis=0) - grow, points.max(axis=0) + grow
    # Link 1 turns on the arm's base, which stands on the riser.
    ignore = ("link_1",) if shape.name in ("arm_base", "riser") else ()
    return StaticBox(
        name=shape.name,
        center=tuple(float(v) for v in (low + high) / 2),  # type: ignore[arg-type]
        half_size=tuple(float(v) for v in (high - low) / 2),  # type: ignore[arg-type]
        ignore_links=ignore,
    )


def _fingers(description: Any, hand: HandModel, joint: int, angle: float) -> list[LinkCapsule]:
    """Fingers at an angle (rad) with their nails, and the thumb folded clear."""
    gripper = description.gripper
    mirror = np.array([-1.0, 1.0, 1.0])
    nail = hand.nail(angle)
    thumb = np.array([0.00279, 0.03126, -0.11467])
    tilt = gripper.reference - gripper.thumb_clear
    thumb_tip = thumb + 0.085 * np.array([0.0, np.sin(tilt), -np.cos(tilt)])
    return [
        _capsule("finger_2", joint, gripper.pivot, nail, _FINGER_RADIUS_M),
        _capsule("finger_3", joint, gripper.pivot * mirror, nail * mirror, _FINGER_RADIUS_M),
        _capsule("thumb", joint, thumb, thumb_tip, _FINGER_RADIUS_M),
    ]


def _held_loop(description: Any, hand: HandModel, joint: int) -> list[LinkCapsule]:
    nails = hand.T_hand_nails(description.gripper.open_angle)[:3, 3]
    half = np.array([0.0, _LOOP_HALF_LENGTH_M, 0.0])
    strands = [nails + np.array([side * _LOOP_HALF_WIDTH_M, 0.0, 0.0]) for side in (-1.0, 1.0)]
    return [_capsule("dispenser", joint, strand - half, strand + half, _LOOP_RADIUS_M) for strand in strands]


def _link_pairs(links: list[str]) -> list[tuple[str, str]]:
    """Links that are not neighbours in the chain; everything fixed to the hand counts as the hand."""
    order = {"link_1": 1, "link_2": 2, "link_3": 3, "link_4": 4, "link_5": 5}
    place = {name: order.get(name, 6) for name in dict.fromkeys(links)}
    names = list(place)
    return [
        (a, b) for i, a in enumerate(names) for b in names[i + 1 :] if abs(place[a] - place[b]) >= 2
        and {place[a], place[b]} != {3, 5} and {place[a], place[b]} != {4, 6}
    ]  # fmt: skip
