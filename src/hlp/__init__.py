"""HLP: 6D pose of known, texture-poor objects in RGB-D images, from their CAD models alone.

A re-implementation of "Combined Holistic and Local Patches for Recovering 6D Object Pose"
(Zhang and Cao, ICCV Workshops 2017) as a configurable experiment framework. `Detector` is the
method without the framework: learn objects from CAD models, find them in RGB-D images.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hlp.method.detector import Detector
    from hlp.method.find.detections import Detection
    from hlp.method.track.tracker import Tracker
    from hlp.method.track.tracking import TrackedDetection, TrackingSettings
    from hlp.records import CameraImage

__version__ = "0.1.0"
__all__ = [
    "CameraImage",
    "Detection",
    "Detector",
    "TrackedDetection",
    "Tracker",
    "TrackingSettings",
]


def __getattr__(name: str) -> Any:
    # Imported at first use, so that `import hlp` alone, as in the command line, stays fast.
    if name in __all__:
        from hlp.method import detector
        from hlp.records import CameraImage

        return CameraImage if name == "CameraImage" else getattr(detector, name)
    raise AttributeError(f"module 'hlp' has no attribute {name!r}")
