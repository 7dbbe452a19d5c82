"""One off-screen scene: the robot, its ghost, a floor and two lights before a camera."""

import copy
from dataclasses import dataclass

import mujoco
import numpy as np

from tlr_exp.pictures.graphics import open_context

_SKY = np.array([0.87, 0.90, 0.94])
_GHOST_RGBA = np.array([0.05, 0.42, 0.95, 0.22])
_GHOST_SETBACK = 0.02  # share of the distance to the camera
_LIGHT_DIRECTION = np.array([-0.37, 0.32, -0.87])
_LIGHT_DISTANCE_M = 4.0
_SHADOW_REACH_M = 14.0
_MAX_GEOMS = 2000
_COLLISION_GROUP = 3  # the customary group of collision shapes; 0 to 2 are drawn anyway


@dataclass(frozen=True)
class Quality:
    """How much work goes into a frame.

    ``cell_m``: meshes are thinned to one vertex a cell of this size (0: left as they are);
    ``shadow_size``: side of the shadow map in pixels; ``samples``: anti-aliasing samples a pixel.
    """

    cell_m: float
    shadow_size: int
    samples: int


# Without a GPU the 393 000 triangles of the robot take most of the time; thinned to 10 mm there
# are 33 000, and at the size of a video nobody sees the difference.
QUALITIES = {"fast": Quality(0.010, 2048, 4), "full": Quality(0.0, 4096, 8)}


class Studio:
    """A robot, its ghost, a floor and two lights before one camera."""

    def __init__(
        self,
        model: mujoco.MjModel,
        width: int,
        height: int,
        azimuth_deg: float,
        elevation_deg: float,
        distance_m: float,
        quality: Quality,
    ) -> None:
        self._model = _studio_model(model, width, height, quality)
        self._robot_data = mujoco.MjData(self._model)
        self._ghost_data = mujoco.MjData(self._model)
        self._option = mujoco.MjvOption()
        self._option.geomgroup[_COLLISION_GROUP] = not _has_visuals(model)
        self._camera = mujoco.MjvCamera()
        self._camera.azimuth = azimuth_deg
        self._camera.elevation = elevation_deg
        self._camera.distance = distance_m
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._gl = open_context(width, height)
        self._scene = mujoco.MjvScene(self._model, _MAX_GEOMS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        self._scene.flags[mujoco.mjtRndFlag.mjRND_HAZE] = True
        self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_150)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)

    def frame(
        self, qpos: np.ndarray, ghost_qpos: np.ndarray | None, lookat: np.ndarray
    ) -> np.ndarray:
        """Draw one state; returns uint8 [height, width, 3]."""
        self._robot_data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._robot_data)
        self._camera.lookat[:] = lookat
        mujoco.mjv_updateScene(
            self._model,
            self._robot_data,
            self._option,
            None,
            self._camera,
            mujoco.mjtCatBit.mjCAT_ALL,
            self._scene,
        )
        self._add_light(lookat)
        if ghost_qpos is not None:
            self._add_ghost(ghost_qpos)
        pixels = np.empty((self._rect.height, self._rect.width, 3), np.uint8)
        self._gl.make_current()
        mujoco.mjr_render(self._rect, self._scene, self._context)
        mujoco.mjr_readPixels(pixels, None, self._rect, self._context)
        return np.ascontiguousarray(pixels[::-1])

    def _add_ghost(self, qpos: np.ndarray) -> None:
        self._ghost_data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._ghost_data)
        first = self._scene.ngeom
        mujoco.mjv_addGeoms(
            self._model,
            self._ghost_data,
            self._option,
            mujoco.MjvPerturb(),
            mujoco.mjtCatBit.mjCAT_DYNAMIC,
            self._scene,
        )
        eye = (self._scene.camera[0].pos + self._scene.camera[1].pos) / 2
        for geom in self._scene.geoms[first : self._scene.ngeom]:
            # Moved back along the line of sight it keeps its place in the picture, but where it
            # coincides with the robot the robot hides it: what shows is where the two differ.
            geom.pos[:] += _GHOST_SETBACK * (geom.pos - eye)
            geom.matid = -1
            geom.rgba[:] = _GHOST_RGBA
            geom.specular = 0.0
            # A decoration throws no shadow: the shadow on the floor is the robot's own.
            geom.category = mujoco.mjtCatBit.mjCAT_DECOR

    def _add_light(self, lookat: np.ndarray) -> None:
        # The model's own lights stand where its author put them; this one goes with the robot.
        direction = _LIGHT_DIRECTION / np.linalg.norm(_LIGHT_DIRECTION)
        light = self._scene.lights[self._scene.nlight]
        light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
        light.dir[:] = direction
        light.pos[:] = lookat - _LIGHT_DISTANCE_M * direction
        light.ambient[:] = 0.0
        light.diffuse[:] = 0.6
        light.specular[:] = 0.3
        light.headlight = 0
        light.castshadow = 1
        self._scene.nlight += 1

    def close(self) -> None:
        """Free what the graphics driver holds."""
        self._gl.make_current()
        self._context.free()
        self._gl.free()


def _has_visuals(model: mujoco.MjModel) -> bool:
    return bool(np.any((model.geom_bodyid > 0) & (model.geom_group < _COLLISION_GROUP)))


def _studio_model(
    model: mujoco.MjModel, width: int, height: int, quality: Quality
) -> mujoco.MjModel:
    """A copy of the model, dressed for pictures: light, floor, sky, frame size, thinned meshes."""
    model = copy.copy(model)
    model.vis.global_.offwidth = width
    model.vis.global_.offheight = height
    model.vis.quality.offsamples = quality.samples
    model.vis.quality.shadowsize = quality.shadow_size
    # Outside of the light's own view the floor is speckled: let it see well past the frame.
    model.vis.map.shadowclip = _SHADOW_REACH_M / model.stat.extent
    model.vis.rgba.haze[:3] = _SKY
    model.vis.headlight.active = 1
    model.vis.headlight.ambient[:] = 0.35
    model.vis.headlight.diffuse[:] = 0.35
    model.vis.headlight.specular[:] = 0.0
    model.light_active[:] = 0
    if not _has_visuals(model):
        model.geom_rgba[:, 3] = 1.0  # collision shapes are drawn in place of the skin
    _lighten_textures(model)
    if quality.cell_m > 0:
        thin_meshes(model, quality.cell_m)
    return model


def _lighten_textures(model: mujoco.MjModel) -> None:
    """Make the sky plain and the floor a light grey, in the texture's own pattern."""
    for i in range(model.ntex):
        channels = model.tex_nchannel[i]
        start = model.tex_adr[i]
        size = model.tex_height[i] * model.tex_width[i] * channels
        pixels = model.tex_data[start : start + size].reshape(-1, channels)
        if model.tex_type[i] == mujoco.mjtTexture.mjTEXTURE_SKYBOX:
            pixels[:, :3] = np.rint(255 * _SKY)
        elif i in _floor_textures(model):
            grey = pixels[:, :3].mean(axis=1, keepdims=True)
            pixels[:, :3] = np.clip(165 + 0.5 * grey, 0, 255)


def _floor_textures(model: mujoco.MjModel) -> set[int]:
    planes = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    materials = {int(i) for i in model.geom_matid[planes] if i >= 0}
    return {int(t) for material in materials for t in model.mat_texid[material] if t >= 0}


def thin_meshes(model: mujoco.MjModel, cell_m: float) -> None:
    """Merge, in place, the vertices of a mesh that share a cell of a grid of ``cell_m`` metres.

    Triangles that lose a corner by it are dropped. For drawing only: the convex hulls that physics
    collides are left as they were, so the model must not be simulated afterwards.
    """
    for i in range(model.nmesh):
        v0, f0 = model.mesh_vertadr[i], model.mesh_faceadr[i]
        vertices = model.mesh_vert[v0 : v0 + model.mesh_vertnum[i]]
        faces = model.mesh_face[f0 : f0 + model.mesh_facenum[i]]
        corner = vertices.min(axis=0)
        # Small parts (the logo, the fingers) keep a finer grid.
        cell = min(cell_m, 0.04 * float(np.ptp(vertices, axis=0).max()))
        cells = np.floor((vertices - corner) / cell).astype(np.int64)
        _, first, cluster = np.unique(cells, axis=0, return_index=True, return_inverse=True)
        cluster = cluster.reshape(-1)
        count = np.bincount(cluster)[:, None]
        sums = np.stack([np.bincount(cluster, weights=vertices[:, k]) for k in range(3)], axis=1)
        vertices[:] = (sums / count)[cluster]
        corners = np.sort(cluster[faces], axis=1)
        kept = np.flatnonzero((corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2]))
        _, unique = np.unique(corners[kept], axis=0, return_index=True)
        kept = kept[np.sort(unique)]
        normals = model.mesh_facenormal[f0 : f0 + len(faces)]
        normals[: len(kept)] = normals[kept]
        faces[: len(kept)] = first[cluster[faces[kept]]]
        model.mesh_facenum[i] = len(kept)
