"""The pictures of a run's stages: where they lie, and what each of them shows."""

from pathlib import Path

STAGES = "stages"
"""Folder of these pictures in a run's folder."""

CAPTIONS = {
    "viewpoints": "Views: where they are rendered from",
    "views": "Views: some of those rendered of each object",
    "training_windows": "Region: what the classifier is trained on",
    "nearest_entries": "Votes: patches of images and the most similar codebook entries",
    "reconstructions": "Votes: what the autoencoder rebuilds from the features of patches",
    "swarm_costs": "Refinement: costs of the poses that the swarm tries",
    "missed_swarm_costs": "Refinement: the same for targets that were missed",
}
"""What each picture shows, by its name without ending, in the order of the stages."""


def drawn_stages(run: Path) -> dict[str, Path]:
    """Files of the pictures that a run has drawn, by their captions, in the order of the stages."""
    files = {words: run / STAGES / f"{name}.jpg" for name, words in CAPTIONS.items()}
    return {words: path for words, path in files.items() if path.is_file()}
