"""pyrender without multisampling and with the shading of `light.shade`.

Imports pyrender and OpenGL, so `opengl` imports it only once rendering starts. Three parts of
pyrender's renderer are replaced: the frame buffer (pyrender resolves depth from 4 samples per
pixel, which is off by up to a pixel's change of depth), its read-out, and the shaders (pyrender's
are physically based, unlike the numba renderer's).
"""

import numpy as np
import pyrender
from OpenGL import GL  # type: ignore[import-untyped]
from pyrender.shader_program import ShaderProgram

from hlp.arrays import CameraMatrix, Image, Pose, Rgb
from hlp.records import Mesh
from hlp.rendering.shading import Light

# World coordinates are the camera's (x right, y down, z forward); OpenGL's camera looks along -z.
_CAMERA_POSE = np.diag([1.0, -1.0, -1.0, 1.0])

_VERTEX_SHADER = """#version 330 core
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec4 color;
uniform mat4 M;
uniform mat4 V;
uniform mat4 P;
out vec3 frag_position;
out vec3 frag_normal;
out vec3 frag_albedo;
void main() {
    vec4 placed = M * vec4(position, 1.0);
    gl_Position = P * V * placed;
    frag_position = placed.xyz;
    frag_normal = mat3(M) * normal;
    frag_albedo = color.rgb;
}
"""

_FRAGMENT_SHADER = """#version 330 core
in vec3 frag_position;
in vec3 frag_normal;
in vec3 frag_albedo;
uniform vec3 light_direction;
uniform float ambient;
uniform float diffuse;
uniform float specular;
uniform float shininess;
out vec4 frag_color;
void main() {
    vec3 view = normalize(-frag_position);
    vec3 normal = normalize(frag_normal);
    if (dot(normal, view) < 0.0) normal = -normal;
    float lambert = max(dot(normal, light_direction), 0.0);
    float halfway = max(dot(normal, normalize(view + light_direction)), 0.0);
    float highlight = lambert > 0.0 ? pow(halfway, shininess) : 0.0;
    vec3 color = frag_albedo * (ambient + diffuse * lambert) + specular * highlight;
    frag_color = vec4(clamp(color, 0.0, 1.0), 1.0);
}
"""


class _SourceProgram(ShaderProgram):  # type: ignore[misc]  # pyrender has no types
    """A shader program from source text instead of files."""

    def _load(self, shader_filename: str) -> str:
        return shader_filename


class _SingleSampleRenderer(pyrender.Renderer):  # type: ignore[misc]
    """pyrender's renderer with one sample a pixel, one light and Blinn-Phong shading."""

    def __init__(self, width: int, height: int) -> None:
        super().__init__(width, height)
        self._program: _SourceProgram | None = None
        self._main_fb_dims: tuple[int, int] = (0, 0)
        self.light: Light | None = None

    def _get_primitive_program(
        self, primitive: object, flags: int, program_flags: int
    ) -> _SourceProgram:
        if self._program is None:
            self._program = _SourceProgram(_VERTEX_SHADER, _FRAGMENT_SHADER)
            self._program._add_to_context()
        return self._program

    def _bind_lighting(
        self, scene: object, program: _SourceProgram, node: object, flags: int
    ) -> None:
        assert self.light is not None
        program.set_uniform("light_direction", np.asarray(self.light.direction))
        for name in ("ambient", "diffuse", "specular", "shininess"):
            program.set_uniform(name, float(getattr(self.light, name)))

    def _configure_main_framebuffer(self) -> None:
        size = (self.viewport_width, self.viewport_height)
        if self._main_fb_dims == size:
            return
        self._delete_main_framebuffer()
        self._main_cb, self._main_db = GL.glGenRenderbuffers(2)
        self._main_fb = GL.glGenFramebuffers(1)
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._main_fb)
        for buffer, layout, attachment in (
            (self._main_cb, GL.GL_RGBA8, GL.GL_COLOR_ATTACHMENT0),
            (self._main_db, GL.GL_DEPTH_COMPONENT24, GL.GL_DEPTH_ATTACHMENT),
        ):
            GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, buffer)
            GL.glRenderbufferStorage(GL.GL_RENDERBUFFER, layout, *size)
            GL.glFramebufferRenderbuffer(GL.GL_FRAMEBUFFER, attachment, GL.GL_RENDERBUFFER, buffer)
        self._main_fb_ms = self._main_fb  # what pyrender draws into
        self._main_fb_dims = size

    def _delete_main_framebuffer(self) -> None:
        if self._main_fb is not None:
            GL.glDeleteFramebuffers(1, [self._main_fb])
            GL.glDeleteRenderbuffers(2, [self._main_cb, self._main_db])
        self._main_fb = None
        self._main_fb_dims = (0, 0)

    def _read_main_framebuffer(self, scene: pyrender.Scene, flags: int) -> tuple[Rgb, Image]:
        width, height = self._main_fb_dims
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self._main_fb)
        area = (0, 0, width, height)
        color = GL.glReadPixels(*area, GL.GL_RGB, GL.GL_UNSIGNED_BYTE)
        buffer = GL.glReadPixels(*area, GL.GL_DEPTH_COMPONENT, GL.GL_FLOAT)
        rgb = np.frombuffer(color, dtype=np.uint8).reshape(height, width, 3)
        stored = np.frombuffer(buffer, dtype=np.float32).reshape(height, width).astype(np.float64)
        camera = scene.main_camera_node.camera
        near, far = camera.znear, camera.zfar
        depth = near * far / (far - stored * (far - near))
        depth[stored == 1.0] = 0.0
        return rgb[::-1].copy(), depth[::-1].astype(np.float32)


class BlinnPhongScene:
    """One OpenGL context and the mesh uploaded to it, until another one is to be shown."""

    def __init__(self) -> None:
        self._window = pyrender.OffscreenRenderer(1, 1)
        self._renderer = _SingleSampleRenderer(1, 1)
        self._window._renderer = self._renderer
        self._scene = pyrender.Scene(bg_color=(0.0, 0.0, 0.0, 0.0))
        self._camera = pyrender.IntrinsicsCamera(1.0, 1.0, 0.0, 0.0)
        self._scene.add(self._camera, pose=_CAMERA_POSE)
        self._mesh: Mesh | None = None
        self._node: pyrender.Node | None = None

    def render(
        self,
        mesh: Mesh,
        pose_cam_obj: Pose,
        camera_matrix: CameraMatrix,
        shape: tuple[int, int],
        light: Light,
        depth_range: tuple[float, float],
    ) -> tuple[Rgb, Image]:
        """Colour and depth (m); what lies outside `depth_range` (m) is cut off."""
        self._scene.set_pose(self._show(mesh), np.asarray(pose_cam_obj, dtype=np.float64))
        self._camera.fx, self._camera.fy = camera_matrix[0, 0], camera_matrix[1, 1]
        # pyrender counts from the corner of the first pixel, OpenCV from its centre.
        self._camera.cx, self._camera.cy = camera_matrix[0, 2] + 0.5, camera_matrix[1, 2] + 0.5
        # pyrender refuses a far plane before the near one, even between two assignments.
        self._camera.znear = min(self._camera.znear, depth_range[0])
        self._camera.zfar, self._camera.znear = depth_range[1], depth_range[0]
        self._renderer.light = light
        self._window.viewport_height, self._window.viewport_width = shape
        rgb, depth = self._window.render(self._scene, pyrender.RenderFlags.SKIP_CULL_FACES)
        return rgb, depth

    def _show(self, mesh: Mesh) -> pyrender.Node:
        """The node of the mesh, which replaces the one before."""
        if mesh is not self._mesh:
            if self._node is not None:
                self._scene.remove_node(self._node)
            opaque = np.ones((len(mesh.colors), 1))
            primitive = pyrender.Primitive(
                positions=mesh.vertices,
                normals=mesh.normals,
                color_0=np.concatenate([mesh.colors / 255.0, opaque], axis=1),
                indices=mesh.faces,
            )
            self._mesh, self._node = mesh, self._scene.add(pyrender.Mesh([primitive]))
        return self._node
