"""Object models from CAD files: meshes, sizes, patch sizes."""
