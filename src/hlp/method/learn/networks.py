"""Loads the trained classifier for detection, without the packages that train it."""

from pathlib import Path

from hlp.method.settings import MachineSettings
from hlp.models.network import Network, load_network

CLASSIFIER = "classifier"


def load_classifier(folder: Path, machine: MachineSettings) -> Network:
    """The classifier that `train_classifier` wrote into `folder`."""
    return load_network(folder / CLASSIFIER, machine.threads, machine.device)
