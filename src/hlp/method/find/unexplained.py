"""What poses leave unexplained of a frame."""

from hlp.arrays import Pose
from hlp.method.find.estimator import FrameContext
from hlp.refinement.verification import Observation


class Unexplained:
    """The part of a frame that poses leave unexplained, which they take one after another.

    `left` is where it begins; None: the whole frame.
    """

    def __init__(self, context: FrameContext, left: Observation | None) -> None:
        self._estimator, self._context, self.left = context.estimator, context, left

    @property
    def observation(self) -> Observation:
        """What is left."""
        return self._context.observation if self.left is None else self.left

    def is_free(self, object_id: int, pose: Pose) -> bool:
        """Whether at least half of the pixels that agree with a pose are left."""
        verifier = self._estimator.verifier(object_id)
        evidence = verifier.evidence(self._context.observation, pose[None])
        return bool(verifier.is_free(self.observation, pose[None], evidence)[0])

    def take(self, object_id: int, pose: Pose) -> None:
        """Leave out what a pose explains."""
        self.left = self._estimator.verifier(object_id).without_explained(self.observation, pose)
