"""Features as those of patches are, and how many of their neighbours a search finds."""

import numpy as np


def surface(count, dimension=24, seed=0):
    """Features on a folded four-dimensional surface, as those of patches lie on one of poses."""
    rng = np.random.default_rng(seed)
    folds = np.random.default_rng(99).normal(size=(2, 4, dimension))
    places = rng.uniform(-1.0, 1.0, (count, 4))
    features = places @ folds[0] + np.sin(3.0 * places @ folds[1])
    features /= np.linalg.norm(features, axis=1, keepdims=True)
    return (features + 0.01 * rng.normal(size=features.shape)).astype(np.float32)


def recall(found, exact):
    pairs = zip(found.indices, exact.indices, strict=True)
    return sum(len(set(a) & set(b)) for a, b in pairs) / exact.indices.size
