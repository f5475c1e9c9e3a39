"""The marker servo as a library: python examples/servo_to_markers.py

A camera that follows every velocity starts 20 cm off and turned; corners of two markers lead it to its goal. On a robot
of your own `update` gets detected corners, and `twist` goes to your arm.
"""

from __future__ import annotations

import numpy as np

from grape.control import MarkerServo, MarkerServoOptions, marker_corners
from grape.geometry import inverse, pose, rotation_exp, rotation_from_rpy, transform

K = np.array([[466.0, 0.0, 319.5], [0.0, 466.0, 239.5], [0.0, 0.0, 1.0]])
SIDE_M = 0.040
T_BASE_GOAL = pose(rotation_from_rpy(-np.pi / 2, 0.0, 0.0))  # the camera looks along y of the base
T_BASE_MARKERS = {  # 30 cm in front of the goal, faces turned to the camera
    number: T_BASE_GOAL @ pose(rotation_from_rpy(np.pi, 0.0, 0.0), (x, 0.03, 0.30))
    for number, x in ((10, -0.085), (11, 0.085))
}


def seen_from(T_base_camera: np.ndarray) -> dict[int, np.ndarray]:
    """Corners (4, 2) px of each marker."""
    corners = {}
    for number, T_base_marker in T_BASE_MARKERS.items():
        points = transform(inverse(T_base_camera) @ T_base_marker, marker_corners(SIDE_M))
        corners[number] = points[:, :2] / points[:, 2:] * K[0, 0] + K[:2, 2]
    return corners


def wanted(number: int, stand_off: float) -> np.ndarray:
    """`T_camera_marker` of a marker when the camera is `stand_off` metres short of its goal."""
    return inverse(T_BASE_GOAL @ pose(translation=(0.0, 0.0, -stand_off))) @ T_BASE_MARKERS[number]


def main() -> None:
    """Servo until it has converged; print the stages."""
    targets = {number: lambda stand_off, number=number: wanted(number, stand_off) for number in T_BASE_MARKERS}
    servo = MarkerServo(targets, SIDE_M, K, MarkerServoOptions(standoff_m=0.08))
    T, stage = T_BASE_GOAL @ pose(rotation_exp(np.array([0.05, -0.1, 0.15])), (0.05, -0.04, -0.20)), None
    for beat in range(3000):
        now = 0.01 * beat
        if beat % 7 == 0:
            state = servo.update(now, seen_from(T), T)
            if state.stage is not stage or state.converged:
                off_mm = 1e3 * np.linalg.norm(T[:3, 3] - T_BASE_GOAL[:3, 3])
                print(f"{now:5.2f} s  {state.stage:<9}  {state.error_px:6.2f} px  {off_mm:5.1f} mm from the goal")
                stage = state.stage
            if state.converged:
                return
        v = servo.twist(now, T)
        T = pose(rotation_exp(v[3:] * 0.01) @ T[:3, :3], T[:3, 3] + v[:3] * 0.01)


if __name__ == "__main__":
    main()
