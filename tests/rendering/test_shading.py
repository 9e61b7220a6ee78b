"""Shades against the formula, scalar by scalar."""

import numpy as np

from hlp.rendering.shading import random_light, shade


def shade_one(albedo, normal, view, light):
    """Blinn-Phong for one point, scalar by scalar."""
    n = np.array(normal) / np.linalg.norm(normal)
    v = np.array(view) / np.linalg.norm(view)
    if n @ v < 0:
        n = -n
    s = np.array(light.direction)
    h = (v + s) / np.linalg.norm(v + s)
    lit = max(float(n @ s), 0.0)
    gloss = max(float(n @ h), 0.0) ** light.shininess if lit > 0 else 0.0
    return [
        min(
            max(round(a * (light.ambient + light.diffuse * lit) + 255 * light.specular * gloss), 0),
            255,
        )
        for a in albedo
    ]


def test_shade_equals_the_scalar_formula():
    rng = np.random.default_rng(0)
    albedo = rng.uniform(0, 255, (200, 3))
    normals, views = rng.normal(size=(200, 3)), rng.normal(size=(200, 3))
    for _ in range(5):
        light = random_light(rng)
        expected = [
            shade_one(list(a), list(n), list(v), light)
            for a, n, v in zip(albedo, normals, views, strict=True)
        ]
        shaded = [shade(*point, light) for point in zip(albedo, normals, views, strict=True)]
        np.testing.assert_array_equal(shaded, expected)


def test_random_lights_stay_in_the_cameras_half_space():
    rng = np.random.default_rng(1)
    lights = [random_light(rng) for _ in range(200)]
    directions = np.array([light.direction for light in lights])
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    assert (directions[:, 2] < 0).all()
    assert directions[:, 0].std() > 0.4 and directions[:, 1].std() > 0.4
