"""Object models from CAD files: meshes, diameters, patch sizes."""
