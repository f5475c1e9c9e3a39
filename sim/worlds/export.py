"""The world as a MuJoCo specification: static geoms in the world body, to which a robot is then attached.

Geoms are named as the world's pieces (`r0v3/spur2`, `r0n1/nail`, `r0/post1`, `r0/wire0_0`, `ground`), so a contact
tells which plant was touched: `geom_name.rpartition("/")[0]`.

Contact bits, as the robot package defines them: world pieces have contype 1 and conaffinity 4. Buds, weeds and marker
plates are seen but never touched: weeds yield in reality, and buds are smaller than the contact model's accuracy.
Physics options (time step, cone) are left to the scene that adds the robot.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from grape.geometry import rotation_to_quaternion
from grape.messages import Array
from grape.sim.worlds.model import Capsule, Label, Plate, Sun, World
from grape.sim.worlds.textures import GRASS, ground_picture, marker_picture

if TYPE_CHECKING:
    import mujoco

WORLD_CONTYPE = 1
WORLD_CONAFFINITY = 4
DRAWN_ONLY = (Label.BUD, Label.WEED, Label.MARKER)
MOST_BODIES = 200  # of the world's pieces, until they are put together
GROUND_DEPTH_M = 0.5  # of solid ground under the lowest point
_HARD = {"solref": [0.004, 1.0], "solimp": [0.98, 0.999, 0.0003, 0.5, 2.0]}
_PICTURE_SEED = 0  # pictures look the same in every world: only geometry depends on the world's seed


def is_large(world: World) -> bool:
    """Whether a body for each plant, post and wire would be too many."""
    pieces: list[Capsule | Plate] = [*world.capsules, *world.plates]
    return len({_owner(piece.name) for piece in pieces}) > MOST_BODIES


def world_spec(world: World, near: Array | None = None, radius: float = np.inf, drawn: bool = True) -> mujoco.MjSpec:
    """A specification with the whole world, or only with what stands near a point.

    Args:
        world: what to export.
        near: (2,) m, map frame; None for everything.
        radius: plants, posts and weeds farther than this from `near` are left out, m. Wires and ground stay.
        drawn: also what is never touched.
    """
    import mujoco

    spec = mujoco.MjSpec()
    spec.modelname = "vineyard"
    spec.compiler.degree = False
    _look(spec, world.sun)
    _ground(spec, world, np.random.default_rng(_PICTURE_SEED))
    bodies = _Bodies(spec, is_large(world))
    unseen = () if drawn else DRAWN_ONLY
    for capsule in world.capsules:
        if capsule.label in unseen:
            continue
        if capsule.label is Label.WIRE or near is None or np.linalg.norm(capsule.p0[:2] - near) <= radius:
            _capsule(bodies.of(capsule.name), capsule)
    for plate in world.plates:
        if plate.label in unseen:
            continue
        if near is None or np.linalg.norm(plate.T_map_plate[:2, 3] - near) <= radius:
            _plate(spec, bodies.of(plate.name), plate)
    return spec


class _Bodies:
    """A static body for each plant, post and wire; in a large vineyard the world's own for all of them.

    The many small bodies of the dispensers are each tested against every body whose bounding box they are in: with all
    plants in one body that is the whole vineyard. But geoms of any other body than the world's cost something in each
    step, wherever the robot is.
    """

    def __init__(self, spec: mujoco.MjSpec, large: bool) -> None:
        self._spec = spec
        self._large = large
        self._bodies: dict[str, mujoco.MjsBody] = {}

    def of(self, geom: str) -> mujoco.MjsBody:
        """The body of a geom (`r0v3/spur2`, `r0/post1`)."""
        if self._large:
            return self._spec.worldbody
        name = _owner(geom)
        if name not in self._bodies:
            self._bodies[name] = self._spec.worldbody.add_body(name=name)
        return self._bodies[name]


def _owner(geom: str) -> str:
    """Name of the thing that a geom belongs to: a plant (`r0v3/`), a row's weeds (`r0/`), or a post or wire by itself.

    The slash at the end keeps ids, in which anything may stand, apart from each other's parts and from the ground.
    """
    owner, slash, part = geom.rpartition("/")
    return geom if part.startswith(("post", "wire")) else owner + slash


def _look(spec: mujoco.MjSpec, sun: Sun) -> None:
    """Cheap rendering: no shadows, no multisampling, few facets; measured to cost 13 to 21 ms for 640 x 480."""
    import mujoco

    spec.stat.extent = 1.0
    visual = spec.visual
    visual.quality.offsamples = 0
    visual.quality.shadowsize = 0
    visual.quality.numslices = 8
    visual.quality.numstacks = 6
    visual.quality.numquads = 1
    visual.map.znear = 0.02
    visual.map.zfar = 80.0
    visual.global_.offwidth = 1280
    visual.global_.offheight = 960
    visual.headlight.ambient = [0.0, 0.0, 0.0]
    visual.headlight.diffuse = [0.0, 0.0, 0.0]
    visual.headlight.specular = [0.0, 0.0, 0.0]
    # The gradient runs from zenith to nadir: this end colour puts the horizon's own colour half way.
    nadir = np.clip(2.0 * np.array(sun.sky_horizon) - np.array(sun.sky_top), 0.0, 1.0)
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=sun.sky_top,
        rgb2=nadir,
        width=64,
        height=384,
    )
    spec.worldbody.add_light(
        name="sun",
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        dir=sun.direction,
        diffuse=sun.diffuse,
        ambient=sun.ambient,
        specular=[0.3 * c for c in sun.diffuse],
        castshadow=False,
    )


def _picture(spec: mujoco.MjSpec, name: str, picture: Array) -> None:
    """A 2-D texture and a dull material of the same name."""
    import mujoco

    height, width, _ = picture.shape
    texture = spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, width=width, height=height, nchannel=3)
    texture.data = np.ascontiguousarray(picture).tobytes()
    material = spec.add_material(name=name, specular=0.0, shininess=0.0)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name


def _ground(spec: mujoco.MjSpec, world: World, rng: np.random.Generator) -> None:
    """The height field, and beyond its edge a plane with the same slope up to the horizon."""
    import mujoco

    terrain = world.terrain
    low, high = float(terrain.heights.min()), float(terrain.heights.max())
    span = max(high - low, 1e-3)
    (x0, x1), (y0, y1) = terrain.x_range, terrain.y_range
    ny, nx = terrain.heights.shape
    spec.add_hfield(
        name="ground",
        size=[(x1 - x0) / 2, (y1 - y0) / 2, span, GROUND_DEPTH_M],
        nrow=ny,
        ncol=nx,
        userdata=((terrain.heights - low) / span).ravel(),
    )
    _picture(spec, "ground", ground_picture(world.site, terrain, rng))
    # A body of its own: else its huge bounding box makes every query pass through the tree of all other pieces.
    spec.worldbody.add_body(name="ground").add_geom(
        name="ground",
        type=mujoco.mjtGeom.mjGEOM_HFIELD,
        hfieldname="ground",
        pos=[(x0 + x1) / 2, (y0 + y1) / 2, low],
        material="ground",
        contype=WORLD_CONTYPE,
        conaffinity=WORLD_CONAFFINITY,
        friction=[1.0, 0.005, 0.0001],
        condim=3,
    )
    middle, tilt = (x0 + x1) / 2, np.arctan(terrain.slope)
    spec.worldbody.add_geom(
        name="horizon",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[60.0, 60.0, 1.0],
        pos=[middle, (y0 + y1) / 2, terrain.slope * middle - 0.15],
        quat=[np.cos(tilt / 2), 0.0, -np.sin(tilt / 2), 0.0],
        rgba=[*GRASS, 1.0],
        contype=0,
        conaffinity=0,
    )


def _touch(label: Label) -> dict[str, Any]:
    if label in DRAWN_ONLY:
        return {"contype": 0, "conaffinity": 0}
    hard = _HARD if label in (Label.SPUR, Label.NAIL) else {}
    return {
        "contype": WORLD_CONTYPE,
        "conaffinity": WORLD_CONAFFINITY,
        "friction": [0.6, 0.005, 0.0001],
        "condim": 4,
        **hard,
    }


def _capsule(body: mujoco.MjsBody, capsule: Capsule) -> None:
    import mujoco

    body.add_geom(
        name=capsule.name,
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        size=[capsule.radius, 0.0, 0.0],
        fromto=[*capsule.p0, *capsule.p1],
        rgba=capsule.rgba,
        **_touch(capsule.label),
    )


def _plate(spec: mujoco.MjSpec, body: mujoco.MjsBody, plate: Plate) -> None:
    import mujoco

    geom = body.add_geom(
        name=plate.name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=plate.half_size,
        pos=plate.T_map_plate[:3, 3],
        quat=rotation_to_quaternion(plate.T_map_plate[:3, :3]),
        rgba=plate.rgba,
        **_touch(plate.label),
    )
    if plate.marker_id is not None:
        _picture(spec, plate.name, marker_picture(plate.marker_id))
        geom.material = plate.name
