"""A small rendered scene for the dispenser's perception: feeder, hand with camera and held loop, spur, hung loop.

World frame = feeder frame: z up, lowest loop's centre at the origin.
"""

import os
from types import SimpleNamespace

os.environ.setdefault("MUJOCO_GL", "egl")

import cv2
import mujoco
import numpy as np
import pytest

from grape.geometry import pose, rotation_to_quaternion, rotation_x
from grape.messages import CameraInfo, RgbdImage
from grape.sim.sensors.rgbd import RgbdModel, measured_color, measured_depth

K = np.array([[466.0, 0, 319.5], [0, 466.0, 239.5], [0, 0, 1]])
TILT = np.radians(13.0)
T_HAND_CAMERA = pose(
    np.column_stack([[1, 0, 0], [0, -np.cos(TILT), -np.sin(TILT)], [0, np.sin(TILT), -np.cos(TILT)]]),
    (0, -0.092, -0.020),
)
NAILS_OPEN, NAILS_CLOSED = np.array([0, -0.0812, -0.2549]), np.array([0, 0.0268, -0.2539])
OPEN_HALF = 0.0265  # half-width of a loop held open
SPUR_TIP = np.array([0.0, 0.75, 0.0])
DOWN = np.eye(3)
SUNS = {
    "noon": ("0.2 0.1 -1", "0.75 0.74 0.7", "0.28 0.29 0.32"),
    "overcast": ("0 0 -1", "0.3 0.3 0.31", "0.5 0.5 0.52"),
    "low": ("0.85 0.45 -0.25", "0.95 0.62 0.32", "0.2 0.19 0.24"),
}


def text(values):
    return " ".join(f"{float(v):.7g}" for v in values)


def loop(prefix, half=0.0145, length=0.140):
    """Tubes and two wings in the x-y plane, as geoms of a body."""
    y = np.linspace(-length / 2, length / 2, 9)
    x = 0.0025 + (half - 0.0025) * 0.5 * (1 + np.cos(2 * np.pi * y / length))
    out = ""
    for side in (-1, 1):
        for k in range(8):
            ends = text([side * x[k], y[k], 0, side * x[k + 1], y[k + 1], 0])
            out += (
                f'<geom name="{prefix}_t{side}_{k}" type="capsule" size="0.0015" fromto="{ends}" rgba=".55 .25 .12 1"/>'
            )
        place = text([side * (half + 0.0055), 0, 0])
        out += (
            f'<geom name="{prefix}_w{side}" type="box" size="0.005 0.006 0.0004" pos="{place}" rgba=".85 .05 .05 1"/>'
        )
    return out


def rod(start, end, radius, rgba, name=""):
    label = f'name="{name}"' if name else ""
    return f'<geom {label} type="capsule" size="{radius}" fromto="{text([*start, *end])}" rgba="{rgba}"/>'


def finger(name, side, nails, x):
    """A finger and its nail, from the palm to the groove at `nails` with lateral place `x`."""
    root, tip = np.array([side * 0.022, -0.027, -0.115]), np.array([side * x, *nails[1:]])
    knee = root + 0.65 * (tip - root) + [side * 0.006, 0, 0]
    nail = rod(knee, tip, 0.0025, ".25 .5 .85 1", f"{name}_nail{side}")
    return rod(root, knee, 0.009, ".7 .7 .7 1", f"{name}_finger{side}") + nail


def marker_texture(id):
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    image = cv2.copyMakeBorder(
        cv2.aruco.generateImageMarker(dictionary, id, 240), *[60] * 4, cv2.BORDER_CONSTANT, value=255
    )
    return cv2.imencode(".png", cv2.merge([image] * 3))[1].tobytes()


class Scene:
    """Renders `RgbdImage`s; what is in the scene is set before each `look`."""

    def __init__(self, sun, ground):
        light, diffuse, ambient = SUNS[sun]
        assets = "".join(
            f'<texture name="m{i}" type="2d" file="m{i}.png"/><material name="m{i}" texture="m{i}" specular="0"/>'
            for i in (1, 2)
        )
        feeder = "".join(
            f'<geom type="box" size="0.03 0.03 0.001" pos="{s * 0.085} -0.060 -0.031" material="m{i}"/>'
            for i, s in ((1, -1), (2, 1))
        )
        feeder += "".join(
            f'<geom type="box" size="0.0115 0.002 0.08" pos="0.0025 {s * 0.088} 0.05" rgba=".88 .88 .84 1"/>'
            for s in (-1, 1)
        )
        loops = "".join(f'<body name="d{k}" mocap="true">{loop(f"d{k}")}</body>' for k in range(8))
        wood = rod(SPUR_TIP - [0, 0, 0.09], SPUR_TIP, 0.005, ".52 .36 .21 1")
        wood += rod([-1, SPUR_TIP[1], -0.1], [1, SPUR_TIP[1], -0.1], 0.02, ".33 .24 .17 1")
        fingers = "".join(
            finger("open", s, NAILS_OPEN, 0.0245) + finger("closed", s, NAILS_CLOSED, 0.0045) for s in (-1, 1)
        )
        camera = rotation_to_quaternion(T_HAND_CAMERA[:3, :3] @ np.diag([1.0, -1, -1]))
        held = f'<body name="held" pos="{text(NAILS_OPEN)}">{loop("held", OPEN_HALF, 0.134)}</body>'
        eye = (
            f'<camera name="eye" pos="{text(T_HAND_CAMERA[:3, 3])}" quat="{text(camera)}" '
            f'fovy="{np.degrees(2 * np.arctan(240 / 466))}"/>'
        )
        xml = f"""<mujoco><statistic extent="1" center="0 0 0"/><visual><global offwidth="640" offheight="480"/>
        <quality offsamples="0" shadowsize="0"/><map znear="0.02" zfar="20"/>
        <headlight ambient="0 0 0" diffuse="0 0 0"/></visual>
        <asset><texture type="skybox" builtin="flat" rgb1=".8 .85 .9" width="64" height="64"/>{assets}</asset>
        <worldbody><light directional="true" castshadow="false" dir="{light}" diffuse="{diffuse}" ambient="{ambient}"/>
        <geom type="plane" size="9 9 .1" pos="0 0 -0.6" rgba="{ground} 1"/>
        <geom type="box" size=".4 .33 .1" pos="0 0 -.25" rgba=".8 .75 .1 1"/>
        {feeder}{loops}{wood}<body name="hung" mocap="true">{loop("hung")}</body>
        <body name="hand" mocap="true">{fingers}{eye}{held}</body></worldbody></mujoco>"""
        self.model = mujoco.MjModel.from_xml_string(xml, {f"m{i}.png": marker_texture(i) for i in (1, 2)})
        self.data = mujoco.MjData(self.model)
        self.renderer = mujoco.Renderer(self.model, 480, 640)
        self.fill(0)
        self.hang(None)

    def move(self, body, T):
        k = self.model.body(body).mocapid[0]
        self.data.mocap_pos[k] = T[:3, 3]
        self.data.mocap_quat[k] = rotation_to_quaternion(T[:3, :3])

    def fill(self, loops):
        """Puts `loops` dispensers into the feeder, from the bottom up."""
        for k in range(8):
            self.move(f"d{k}", pose(translation=(0, 0, 0.018 * k) if k < loops else (0, 0, -9)))

    def hang(self, T):
        """Hangs a loop at a pose of its centre, or takes it away."""
        self.move("hung", pose(translation=(0, 0, -9)) if T is None else T)

    def look(self, T_world_hand, *, held=False, fingers="open", seed=0):
        """The camera's image with the sensor's noise, and the true `T_camera_world`."""
        self.move("hand", T_world_hand)
        for prefix, shown in (("held", held), ("open", fingers == "open"), ("closed", fingers == "closed")):
            for k in range(self.model.ngeom):
                if self.model.geom(k).name.startswith(prefix):
                    self.model.geom_rgba[k, 3] = float(shown)
        mujoco.mj_forward(self.model, self.data)
        self.renderer.update_scene(self.data, "eye")
        bgr = self.renderer.render()[:, :, ::-1].copy()
        self.renderer.enable_depth_rendering()
        depth = self.renderer.render().copy()
        self.renderer.disable_depth_rendering()
        rng, model = np.random.default_rng(seed), RgbdModel()
        noise = np.rint(rng.normal(0, model.noise, bgr.shape)).astype(np.int16)
        image = RgbdImage(
            stamp=0.0,
            bgr=measured_color(bgr, noise, model),
            depth=measured_depth(depth, rng.standard_normal(depth.shape, dtype=np.float32), 466.0, model),
            info=CameraInfo(stamp=0.0, width=640, height=480, K=K),
        )
        return image, np.linalg.inv(T_world_hand @ T_HAND_CAMERA)


def over_feeder(level, height, shift=(0, 0, 0)):
    """T_world_hand: pointing down, closed nails `height` above a level."""
    return pose(DOWN, np.array([0, 0, 0.018 * level + height]) + shift - NAILS_CLOSED)


def at_spur(pitch_deg, back, drop=0.0):
    """T_world_hand pitched from the row (y), nails 28 mm before the spur, then moved back and down."""
    R = rotation_x(np.radians(pitch_deg))
    nails = SPUR_TIP - [0, 0, 0.03] - R @ [0, 0.028, 0] + R @ [0, 0, back] - [0, 0, drop]
    return pose(R, nails - R @ NAILS_OPEN)


@pytest.fixture(scope="session")
def make_scene():
    scenes = {}

    def make(sun="noon", ground=".45 .36 .25"):
        if (sun, ground) not in scenes:
            scenes[sun, ground] = Scene(sun, ground)
        return scenes[sun, ground]

    yield make
    for scene in scenes.values():
        scene.renderer.close()


@pytest.fixture(scope="session")
def views():
    """Hand poses and constants of the scene."""
    return SimpleNamespace(
        over_feeder=over_feeder,
        at_spur=at_spur,
        K=K,
        SPUR_TIP=SPUR_TIP,
        NAILS_OPEN=NAILS_OPEN,
        T_HAND_CAMERA=T_HAND_CAMERA,
    )
