"""Costs of poses that searches can be tested on, without any image."""

import numpy as np

from hlp.geometry import rigid, rotation_distance

CENTROID = np.array([0.02, -0.01, 0.03])


def start():
    return rigid(np.eye(3), np.array([0.0, 0.0, 0.8]))


class Bowl:
    """Distance to a known pose: 1 for each radian and for each 0.1 m of the centroid."""

    def __init__(self, goal):
        self.goal = goal
        self.costs = []

    def evaluate(self, poses):
        middle = poses[:, :3, :3] @ CENTROID + poses[:, :3, 3]
        goal = self.goal[:3, :3] @ CENTROID + self.goal[:3, 3]
        angle = rotation_distance(poses[:, :3, :3], self.goal[:3, :3])
        costs = angle**2 + (np.linalg.norm(middle - goal, axis=1) / 0.1) ** 2
        self.costs.append(costs.copy())  # the search changes what it is given
        return costs


class Rippled:
    """A cost with many minima: waves over the twelve numbers of a pose."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.waves = rng.normal(scale=20.0, size=(12, 5))
        self.lowest = np.inf

    def evaluate(self, poses):
        costs = np.sin(poses[:, :3].reshape(-1, 12) @ self.waves).sum(axis=1)
        self.lowest = min(self.lowest, float(costs.min()))
        return costs
