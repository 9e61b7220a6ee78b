"""Loads the trained classifier and encoder for detection, without the packages that train them."""

from pathlib import Path

import numpy as np

from hlp.method.settings import EncoderSettings, MachineSettings
from hlp.models.contrastive import ContrastiveSettings
from hlp.models.encoder import Encoder, NetworkEncoder
from hlp.models.network import Network, load_network
from hlp.models.pca import PcaEncoder, PcaSettings

CLASSIFIER, ENCODER, PCA = "classifier", "encoder", "pca.npz"


def load_classifier(folder: Path, machine: MachineSettings) -> Network:
    """The classifier that `train_classifier` left in `folder`."""
    return load_network(folder / CLASSIFIER, machine.threads, machine.device)


def load_encoder(settings: EncoderSettings, folder: Path, machine: MachineSettings) -> Encoder:
    """The encoder that `train_encoder` left in `folder`."""
    if isinstance(settings, PcaSettings):
        with np.load(folder / PCA) as stored:
            return PcaEncoder(stored["mean"], stored["components"], settings.cells)
    network = load_network(folder / ENCODER, machine.threads, machine.device)
    return NetworkEncoder(network, settings.input, isinstance(settings, ContrastiveSettings))
