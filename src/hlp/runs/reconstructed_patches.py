"""Patches of a frame beside what the decoder makes of their features."""

from hlp.models.encoder_input import patch_input
from hlp.models.encoders import FeatureDecoder
from hlp.records import LocalPatches
from hlp.reporting.figures.reconstructions import ReconstructedPatches
from hlp.runs.patch_entries import encode
from hlp.stages.training import TrainingStages


def reconstruct(
    training: TrainingStages, name: str, patches: LocalPatches
) -> ReconstructedPatches | None:
    """Patches with colour as the encoder takes and rebuilds them, from the features of detection.

    None if there are none, if the encoder has no decoder, or if its training kept none.
    """
    settings = training.settings.encoder
    if len(patches) == 0 or not isinstance(settings, FeatureDecoder):
        return None
    features = encode(training.load_encoder(), patches)
    rebuilt = settings.decode(training.encoder().folder, features)
    if rebuilt is None:
        return None
    return ReconstructedPatches(name, patch_input(patches, settings.input), rebuilt)
