"""The table, the arm, the things on the table and the three cameras as one MuJoCo model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import mujoco
import numpy as np

from hw.sim.layout import (
    BLOCK_EDGE_M,
    BLOCK_HEIGHT_M,
    CONTAINER_HEIGHT_M,
    CONTAINER_INNER_M,
    CONTAINER_WALL_M,
    Layout,
    Placement,
)
from hw.sim.viewpoints import FIXED_VIEWPOINTS, FixedViewpoint
from hw.sim.world import textures
from hw.sim.world.lite6_model import (
    ARM_BIT,
    BLOCK_BIT,
    FIXED_BIT,
    MOVING_GROUP,
    arm_actuators,
    arm_body,
    arm_defaults,
    finger_coupling,
)
from tams_app.records import Image

STEP_NS = 1_000_000  # physics step; the contact grasp needs it this short (FINDINGS 9)
BLOCK_MASS_KG = 0.02

_TEXTURE_SEED = 0x7A3C
_MAT_M = (0.42, 0.60)  # along x, along y; its top is the table top, z = 0
_MAT_CENTRE_M = (0.315, 0.0)
_FIXED = f'contype="{FIXED_BIT}" conaffinity="0"'
_SCENERY = 'contype="0" conaffinity="0"'

CONTAINER_PAINT = (26, 82, 176)
BLOCK_DARK, BLOCK_BRIGHT = (150, 22, 12), (255, 150, 40)

Painter = Callable[[np.random.Generator], Image]
Face = Callable[[np.random.Generator, int], Image]


@dataclass(frozen=True, slots=True)
class _Texture:
    """A texture of the scene; a cube has six faces of `height` by `width` below one another."""

    kind: str
    height: int
    width: int
    paint: Painter


def _flat(height: int, width: int, paint: Callable[..., Image], *arguments: object) -> _Texture:
    return _Texture("2d", height, width, lambda random: paint(random, height, width, *arguments))


def _cube(edge: int, face: Face) -> _Texture:
    return _Texture(
        "cube", edge, edge, lambda random: np.concatenate([face(random, edge) for _ in range(6)])
    )


def _square(paint: Callable[..., Image], *arguments: object) -> Face:
    return lambda random, edge: paint(random, edge, edge, *arguments)


def _marker_face(
    identity: int, dark: textures.Colour, bright: textures.Colour, quiet_cells: int = 1
) -> Face:
    return lambda random, edge: textures.marker(random, edge, identity, dark, bright, quiet_cells)


_TEXTURES = {
    "table": _flat(1024, 1024, textures.wood),
    "mat": _flat(1024, 2048, textures.work_mat, _MAT_M),
    "wall": _flat(512, 512, textures.brick),
    "floor": _flat(512, 512, textures.concrete),
    "poster": _flat(512, 256, textures.label),
    "sheet": _flat(512, 256, textures.label),
    "housing": _cube(128, _square(textures.brushed)),
    "arm_print": _cube(128, _square(textures.label, (226, 228, 230), (60, 62, 70))),
    "gripper_marker": _cube(128, _marker_face(3, textures.INK, textures.WHITE)),
    "block": _cube(128, _marker_face(1, BLOCK_DARK, BLOCK_BRIGHT)),
    "bin_wall": _cube(256, _square(textures.panel, CONTAINER_PAINT)),
    "bin_floor": _cube(256, _marker_face(2, (14, 40, 110), (120, 190, 250), quiet_cells=3)),
    "carton": _cube(256, _square(textures.card)),
    "can": _cube(256, _square(textures.label, (188, 60, 132), (250, 240, 246))),
    "jar": _cube(256, _square(textures.label, (236, 232, 220), (64, 40, 92))),
    "tin": _cube(256, _square(textures.label, (58, 56, 62), (230, 206, 120))),
}


def build_model(layout: Layout, *, textured: bool) -> mujoco.MjModel:
    """The compiled scene of `layout`; physics needs no textures, frames do."""
    model = mujoco.MjModel.from_xml_string(scene_xml(layout))
    if textured:
        _paint(model)
    return model


def _paint(model: mujoco.MjModel) -> None:
    for name, pixels in _painted().items():
        start = int(model.tex_adr[model.texture(name).id])
        model.tex_data[start : start + pixels.size] = pixels


@cache
def _painted() -> dict[str, Image]:
    """Pixels of each texture, shape (n,): the same in every scene."""
    return {
        name: texture.paint(np.random.default_rng([_TEXTURE_SEED, place])).ravel()
        for place, (name, texture) in enumerate(_TEXTURES.items())
    }


def scene_xml(layout: Layout) -> str:
    """The MJCF text of `layout`; what is near comes first, so that what it hides costs little."""
    return f"""
<mujoco model="tams_rig">
<compiler angle="radian" autolimits="true"/>
<option timestep="{STEP_NS / 1e9}" integrator="implicitfast" cone="elliptic" impratio="10"
 noslip_iterations="3"/>
<statistic extent="1" center=".3 0 .1"/>
<visual>
 <global offwidth="640" offheight="480"/>
 <quality offsamples="0" numslices="16" numstacks="6" numquads="1"/>
 <headlight ambient=".34 .34 .34" diffuse=".22 .22 .22" specular="0 0 0"/>
 <map znear=".004" zfar="6"/>
</visual>
{_assets()}
<default>{arm_defaults()}</default>
<worldbody>
 <light pos=".1 -.7 1.7" dir=".12 .38 -1" diffuse=".52 .51 .48" specular=".18 .18 .18"
 castshadow="false"/>
 <light pos=".9 .8 1.5" dir="-.4 -.5 -1" diffuse=".24 .25 .28" specular=".08 .08 .08"
 castshadow="false"/>
 {arm_body()}
 {_block(layout.block)}
 {_container(layout.container)}
 {_scenery()}
 {_room()}
 {_cameras()}
</worldbody>
<equality>{finger_coupling()}</equality>
<actuator>{arm_actuators()}</actuator>
</mujoco>"""


def _assets() -> str:
    declared = "\n".join(
        f'<texture name="{name}" type="{texture.kind}" builtin="flat" width="{texture.width}" '
        f'height="{texture.height}"/>'
        f'<material name="{name}" texture="{name}" specular=".05" '
        f'shininess=".35" texrepeat="{_REPEATS.get(name, "1 1")}"/>'
        for name, texture in _TEXTURES.items()
    )
    return f"""
<asset>
 {declared}
 <material name="joint" rgba=".30 .31 .34 1" specular=".3" shininess=".4"/>
 <material name="shell" rgba=".88 .88 .89 1" specular=".35" shininess=".35"/>
 <material name="steel" rgba=".68 .69 .72 1" specular=".5" shininess=".5"/>
 <material name="fingertip" rgba=".16 .78 .28 1" specular=".1"/>
 <material name="handle" rgba=".46 .20 .52 1" specular=".3"/>
</asset>"""


_REPEATS = {"floor": "6 6", "wall": "2 1"}


def _room() -> str:
    depth, width = _MAT_M
    x, y = _MAT_CENTRE_M
    # a box shows a 2d texture along its own x and y: the mat's figures read from the base outwards
    return f"""
<body name="room">
 <geom name="mat" type="box" size="{width / 2} {depth / 2} .005" pos="{x} {y} -.005"
  euler="0 0 -1.5708" material="mat" friction="1 .01 .001" {_FIXED}/>
 <geom name="table" type="box" size=".70 .52 .02" pos=".22 0 -.0215" euler="0 0 1.5708"
  material="table" friction="1 .01 .001" {_FIXED}/>
 <geom type="box" size=".21 .297 .004" pos="-.726 .12 .52" euler="1.5708 1.5708 0"
  material="poster" {_SCENERY}/>
 <geom type="box" size=".21 .297 .004" pos=".1 1.094 .50" euler="1.5708 0 0"
  material="poster" {_SCENERY}/>
 <geom type="box" size="1.9 1.0 .02" pos="0 1.12 .2" euler="1.5708 0 0"
  material="wall" {_SCENERY}/>
 <geom type="box" size="1.9 1.0 .02" pos="-.75 0 .2" euler="1.5708 1.5708 0"
  material="wall" {_SCENERY}/>
 <geom type="box" size="1.9 1.0 .02" pos="2.2 0 .2" euler="1.5708 -1.5708 0"
  material="wall" {_SCENERY}/>
 <geom type="box" size="1.9 1.0 .02" pos="0 -1.7 .2" euler="-1.5708 0 0"
  material="wall" {_SCENERY}/>
 <geom name="floor" type="plane" size="3 3 .1" pos="0 0 -.75" material="floor" {_SCENERY}/>
</body>"""


def _scenery() -> str:
    """Things that stand about: beside the work area, where arm and block do not go."""
    return f"""
<body name="scenery">
<geom type="box" size=".055 .075 .045" pos=".07 -.36 .0437" euler="0 0 .35" material="carton"
 {_FIXED}/>
<geom type="box" size=".05 .05 .035" pos=".06 .35 .0337" euler="0 0 -.5" material="carton"
 {_FIXED}/>
<geom type="cylinder" size=".027 .045" pos=".535 -.300 .0437" euler="0 0 .6" material="can"
 {_FIXED}/>
<geom type="cylinder" size=".031 .032" pos=".545 .275 .0307" euler="0 0 -.4" material="jar"
 {_FIXED}/>
<geom type="cylinder" size=".022 .036" pos=".585 .205 .0347" euler="0 0 1.1" material="tin"
 {_FIXED}/>
<geom type="box" size=".074 .105 .0006" pos=".58 -.09 -.0009" euler="0 0 -1.35" material="sheet"
 {_SCENERY}/>
<geom type="cylinder" size=".0035 .055" pos=".515 .09 .0022" euler="1.5708 0 .35" material="steel"
 {_SCENERY}/>
<geom type="capsule" size=".010 .032" pos=".545 .010 .0087" euler="1.5708 0 .35" material="handle"
 {_SCENERY}/>
<geom type="cylinder" size=".006 .0025" pos=".490 -.165 .0025" material="steel" {_SCENERY}/>
<geom type="cylinder" size=".006 .0025" pos=".507 -.150 .0025" material="steel" {_SCENERY}/>
<geom type="cylinder" size=".006 .0025" pos=".486 -.143 .0025" material="steel" {_SCENERY}/>
</body>"""


def _container(place: Placement) -> str:
    half, wall, height = CONTAINER_INNER_M / 2, CONTAINER_WALL_M / 2, CONTAINER_HEIGHT_M / 2
    outer, middle = half + 2 * wall, half + wall
    sides = (
        (middle, 0, wall, outer), (-middle, 0, wall, outer),
        (0, middle, half, wall), (0, -middle, half, wall),
    )  # fmt: skip
    walls = "\n".join(
        f'<geom type="box" size="{wide} {deep} {height}" pos="{x} {y} {height}" '
        f'material="bin_wall" {_FIXED}/>'
        for x, y, wide, deep in sides
    )
    return f"""
<body name="container" pos="{place.x} {place.y} 0" euler="0 0 {place.yaw}">
 <geom type="box" size="{half} {half} .001" pos="0 0 .001" material="bin_floor" {_FIXED}/>
 {walls}
</body>"""


def _block(place: Placement) -> str:
    edge, height = BLOCK_EDGE_M / 2, BLOCK_HEIGHT_M / 2
    return f"""
<body name="block" pos="{place.x} {place.y} {height}" euler="0 0 {place.yaw}"><freejoint
 name="block"/>
 <geom name="block" type="box" size="{edge} {edge} {height}" mass="{BLOCK_MASS_KG}" material="block"
  group="{MOVING_GROUP}" condim="4" friction="1 .02 .001"
  contype="{BLOCK_BIT}" conaffinity="{FIXED_BIT | ARM_BIT}"/>
</body>"""


def _cameras() -> str:
    """The two cameras that do not move: above the table, and at its side."""
    return "".join(_camera(view, seen) for view, seen in FIXED_VIEWPOINTS.items())


def _camera(view: str, viewpoint: FixedViewpoint) -> str:
    right, down, _ = viewpoint.axes().T
    axes = " ".join(f"{part:.6f}" for part in (*right, *-down))
    x, y, z = viewpoint.place
    return (
        f'<camera name="{view}" pos="{x} {y} {z}" xyaxes="{axes}" fovy="{viewpoint.fovy_deg}"/>\n'
    )
