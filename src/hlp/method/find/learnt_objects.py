"""Interface of learnt objects, wherever they are kept."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

from hlp.models.encoder import Encoder
from hlp.models.network import Network
from hlp.records import Codebook, ObjectModel
from hlp.refinement.score_model import ScoreModel


class LearntObjects(Protocol):
    """What detection needs from learnt objects. Each part is loaded when first needed."""

    @property
    def models(self) -> Mapping[int, ObjectModel]:
        """Object models by id."""
        ...

    @property
    def classes(self) -> Sequence[int]:
        """Object id of each class of the classifier, from class 1 on; class 0 is background."""
        ...

    def load_classifier(self) -> Network:
        """The classifier of holistic patches."""
        ...

    def load_encoder(self) -> Encoder:
        """The encoder of local patches."""
        ...

    def load_codebook(self, object_id: int) -> Codebook:
        """The codebook of one object."""
        ...

    def load_score_model(self, object_id: int) -> ScoreModel:
        """The score of one object's poses."""
        ...

    def search_folder(self, object_ids: Sequence[int]) -> Path | None:
        """The folder in which the search in the codebooks of these objects was prepared.

        None if it was not.
        """
        ...
