"""Kinematics of a serial arm, read from its MJCF and computed by Pinocchio."""

from __future__ import annotations

from math import isfinite
from pathlib import Path

import numpy as np
import pinocchio as pin

from grape.errors import InvalidInput
from grape.kinematics.mjcf import Link, read_chain
from grape.messages import Array, frozen_array

ROTATION_WEIGHT = 0.2  # m/rad: turns angular rows of a Jacobian into metres at the fingertips


class ArmModel:
    """A chain of hinges from the arm's base frame to its hand frame.

    Keeps one scratch buffer: use one model per thread. Angles are absolute; the model itself does not clip them.

    Args:
        links: the links, root first, as `read_chain` returns them.
    """

    def __init__(self, links: tuple[Link, ...]) -> None:
        self._model = _build(links)
        self._data = self._model.createData()
        self.dof = len(links)
        self.joints = tuple(link.joint for link in links)
        self.links = tuple(link.name for link in links)
        self.position_min = frozen_array([link.position_min for link in links], float)
        self.position_max = frozen_array([link.position_max for link in links], float)
        self.torque_max = frozen_array([link.torque_max for link in links], float)
        self.placements = frozen_array([link.T_parent_link for link in links], float)  # (n, 4, 4) at angle 0
        self.axes = frozen_array([link.axis / np.linalg.norm(link.axis) for link in links], float)  # (n, 3) in the link

    @classmethod
    def from_mjcf(cls, path: Path, base: str = "arm_base", tip: str = "hand") -> ArmModel:
        """The chain between the bodies `base` and `tip` of an MJCF file."""
        return cls(read_chain(path, base, tip))

    def fk(self, q: Array) -> Array:
        """Pose `T_base_hand` (4, 4) for joint angles q (n,) rad."""
        pin.forwardKinematics(self._model, self._data, self.checked(q))
        return np.asarray(self._data.oMi[self.dof].homogeneous)

    def link_poses(self, q: Array) -> Array:
        """Poses (n, 4, 4) of every link in the base frame, root first; the last one is the hand."""
        pin.forwardKinematics(self._model, self._data, self.checked(q))
        return np.array([self._data.oMi[i + 1].homogeneous for i in range(self.dof)])

    def frame_poses(self, q: Array) -> dict[str, Array]:
        """Poses (4, 4) of every link in the base frame by link name."""
        return dict(zip(self.links, self.link_poses(q), strict=True))

    def jacobian(self, q: Array) -> Array:
        """Jacobian (6, n) of the hand's origin: linear rows first, then angular, both along the base axes."""
        pin.computeJointJacobians(self._model, self._data, self.checked(q))
        return np.asarray(
            pin.getJointJacobian(self._model, self._data, self.dof, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        )

    def fk_jacobian(self, q: Array) -> tuple[Array, Array]:
        """`fk(q)` and `jacobian(q)` of one pass."""
        J = self.jacobian(q)
        return np.asarray(self._data.oMi[self.dof].homogeneous), J

    def sigma_min(self, q: Array) -> float:
        """Least singular value of the Jacobian with angular rows times 0.2 m/rad: near 0 at a singularity."""
        J = self.jacobian(q).copy()
        J[3:] *= ROTATION_WEIGHT
        return float(np.linalg.svd(J, compute_uv=False)[-1])

    def gravity_torque(self, q: Array, gravity: Array | tuple[float, float, float] = (0.0, 0.0, -9.81)) -> Array:
        """Torques (n,) N m that hold the arm still; `gravity` (3,) m/s^2 in the base frame (tilted with the base)."""
        self._model.gravity.linear = np.asarray(gravity, float)
        return np.array(pin.computeGeneralizedGravity(self._model, self._data, self.checked(q)))

    def mass_matrix(self, q: Array) -> Array:
        """Joint-space inertia (n, n) kg m^2 of the links alone, without what turns in the motors."""
        pin.crba(self._model, self._data, self.checked(q))
        M = np.array(self._data.M)
        return np.asarray(np.triu(M) + np.triu(M, 1).T)

    def momentum_rate(
        self, q: Array, dq: Array, gravity: Array | tuple[float, float, float] = (0.0, 0.0, -9.81)
    ) -> Array:
        """`C(q, dq)^T dq - g(q)` (n,) N m: what changes the links' momentum `M(q) dq` beside torques on the joints.

        Args:
            q, dq: (n,) rad and rad/s.
            gravity: as in `gravity_torque`.
        """
        self._model.gravity.linear = np.asarray(gravity, float)
        q, dq = self.checked(q), self.checked(dq)
        C = pin.computeCoriolisMatrix(self._model, self._data, q, dq)
        return np.asarray(C.T @ dq - pin.computeGeneralizedGravity(self._model, self._data, q))

    def limit_distance(self, q: Array) -> float:
        """Distance (rad) to the nearest joint limit, negative beyond it; inf when every joint is continuous."""
        q = self.checked(q)
        return float(np.min(np.minimum(q - self.position_min, self.position_max - q)))

    def within_limits(self, q: Array) -> bool:
        """Whether every joint is inside its limits."""
        return self.limit_distance(q) >= 0.0

    def nearest_winding(self, q: Array, reference: Array) -> Array:
        """The same arm pose with each continuous joint in the turn that is nearest to `reference` (n,) rad."""
        turns = np.round((np.asarray(reference) - q) / (2 * np.pi))
        return np.where(np.isinf(self.position_min), q + 2 * np.pi * turns, q)

    def checked(self, q: Array) -> Array:
        """Joint angles (n,) rad as floats.

        Raises:
            InvalidInput: another shape, or not finite.
        """
        q = np.asarray(q, dtype=float)
        if q.shape != (self.dof,) or not isfinite(sum(q.tolist())):
            raise InvalidInput(f"joint angles must be {self.dof} finite numbers in rad, got {q}")
        return q


def _build(links: tuple[Link, ...]) -> pin.Model:
    model = pin.Model()
    parent = 0
    for link in links:
        placement = pin.SE3(link.T_parent_link[:3, :3], link.T_parent_link[:3, 3])
        joint = pin.JointModelRevoluteUnaligned(link.axis / np.linalg.norm(link.axis))
        if np.array_equal(link.axis, (0.0, 0.0, 1.0)):
            joint = pin.JointModelRZ()
        parent = model.addJoint(parent, joint, placement, link.joint)
        for body in link.inertias:
            model.appendBodyToJoint(parent, pin.Inertia(body.mass, body.center, body.inertia), pin.SE3.Identity())
    return model
