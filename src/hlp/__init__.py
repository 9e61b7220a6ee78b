"""HLP: 6D pose of known, texture-poor objects in RGB-D images, from their CAD models alone.

A re-implementation of "Combined Holistic and Local Patches for Recovering 6D Object Pose"
(Zhang and Cao, ICCV Workshops 2017) as a configurable experiment framework. `Detector` is the
method without the framework: learn objects from CAD models, find them in RGB-D images.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hlp.method.arguments import RgbdFrame as RgbdFrame
    from hlp.method.detector import Detector as Detector
    from hlp.method.find.detections import Detection as Detection
    from hlp.method.find.detections import Rejection as Rejection
    from hlp.method.find.detections import RunnerUp as RunnerUp
    from hlp.method.find.detections import SearchResult as SearchResult
    from hlp.method.find.detections import TrackedDetection as TrackedDetection
    from hlp.method.find.detections import TrackingResult as TrackingResult
    from hlp.method.settings import MethodSettings as MethodSettings
    from hlp.method.settings import TrackingSettings as TrackingSettings
    from hlp.method.tracker import Tracker as Tracker
    from hlp.records import CameraImage as CameraImage
    from hlp.records import Frame as Frame
    from hlp.records import ObjectModel as ObjectModel
    from hlp.refinement.pose_fit import PoseFit as PoseFit

__version__ = "0.3.0"
_HOMES = {
    "CameraImage": "hlp.records",
    "Detection": "hlp.method.find.detections",
    "Detector": "hlp.method.detector",
    "Frame": "hlp.records",
    "MethodSettings": "hlp.method.settings",
    "ObjectModel": "hlp.records",
    "PoseFit": "hlp.refinement.pose_fit",
    "Rejection": "hlp.method.find.detections",
    "RgbdFrame": "hlp.method.arguments",
    "RunnerUp": "hlp.method.find.detections",
    "SearchResult": "hlp.method.find.detections",
    "TrackedDetection": "hlp.method.find.detections",
    "Tracker": "hlp.method.tracker",
    "TrackingResult": "hlp.method.find.detections",
    "TrackingSettings": "hlp.method.settings",
}
"""Everything that stands in a public signature, and the module that it is in."""
__all__ = [*_HOMES]


def __getattr__(name: str) -> Any:
    # Imported at first use, so that `import hlp` alone, as in the command line, stays fast.
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'hlp' has no attribute {name!r}")
