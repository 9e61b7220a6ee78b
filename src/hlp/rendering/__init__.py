"""Views of CAD models: where to look from, and RGB-D pictures by OpenGL or by a numba z-buffer."""
