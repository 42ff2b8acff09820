"""How the MuJoCo car and its world look: a cabin, daylight, sky, and a road whose chequers show the motion."""

from collections.abc import Sequence

import mujoco

from sidestep.plant_models.vehicle.parameters import VehicleParameters

_CABIN_LENGTH, _CABIN_WIDTH, _CABIN_HEIGHT, _CABIN_SHIFT = 0.46, 0.84, 0.45, -0.06  # of the car; height in [m]


def add_looks(spec: mujoco.MjSpec, road: str = "road") -> None:
    """Give the specification light, sky and a material for the geom `road`; nothing that moves feels it."""
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.45] * 3, [0.35] * 3
    spec.visual.map.zfar = 500.0
    light = spec.worldbody.add_light(name=f"sun over {road}", type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
    light.pos, light.dir, light.diffuse, light.castshadow = [0, 0, 50], [0.3, 0.2, -1.0], [0.6] * 3, False
    sky = spec.add_texture(name=f"sky over {road}", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, width=64, height=384)
    sky.builtin, sky.rgb1, sky.rgb2 = mujoco.mjtBuiltin.mjBUILTIN_GRADIENT, [0.55, 0.7, 0.9], [0.85, 0.9, 0.95]
    chequers = spec.add_texture(name=road, type=mujoco.mjtTexture.mjTEXTURE_2D, width=64, height=64)
    chequers.builtin, chequers.rgb1, chequers.rgb2 = mujoco.mjtBuiltin.mjBUILTIN_CHECKER, [0.33] * 3, [0.37] * 3
    asphalt = spec.add_material(name=road, texrepeat=[0.1, 0.1], texuniform=True)
    asphalt.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB.value] = road
    spec.geom(road).material = road


def add_cabin(chassis: mujoco.MjsBody, vehicle: VehicleParameters, base: Sequence[float]) -> None:
    """Set a cabin that touches nothing on the body, `base` [m] the middle of its belt line."""
    x, y, z = base
    chassis.add_geom(
        name="cabin", type=mujoco.mjtGeom.mjGEOM_BOX, mass=0.0, contype=0, conaffinity=0, rgba=[0.12, 0.15, 0.2, 1.0],
        size=[_CABIN_LENGTH * vehicle.length / 2.0, _CABIN_WIDTH * vehicle.width / 2.0, _CABIN_HEIGHT / 2.0],
        pos=[x + _CABIN_SHIFT * vehicle.length, y, z + _CABIN_HEIGHT / 2.0],
    )  # fmt: skip
