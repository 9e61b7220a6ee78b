"""HLP: 6D pose of known, texture-poor objects in RGB-D images, from their CAD models alone.

A re-implementation of "Combined Holistic and Local Patches for Recovering 6D Object Pose"
(Zhang and Cao, ICCV Workshops 2017) as a configurable experiment framework. `Detector` is the
method without the framework: learn objects from CAD models, find them in RGB-D images.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hlp.method.arguments import RgbdFrame
    from hlp.method.detector import Detector
    from hlp.method.find.detections import (
        Detection,
        Rejection,
        RunnerUp,
        SearchResult,
        TrackedDetection,
        TrackingResult,
    )
    from hlp.method.settings import MethodSettings, TrackingSettings
    from hlp.method.track.tracker import Tracker
    from hlp.records import CameraImage, Frame, ObjectModel
    from hlp.refinement.pose_fit import PoseFit

__version__ = "0.3.0"
_HOMES = {
    "hlp.method.arguments": ("RgbdFrame",),
    "hlp.method.detector": ("Detector",),
    "hlp.method.find.detections": (
        "Detection", "Rejection", "RunnerUp", "SearchResult", "TrackedDetection", "TrackingResult",
    ),
    "hlp.method.settings": ("MethodSettings", "TrackingSettings"),
    "hlp.method.track.tracker": ("Tracker",),
    "hlp.records": ("CameraImage", "Frame", "ObjectModel"),
    "hlp.refinement.pose_fit": ("PoseFit",),
}  # fmt: skip
"""Everything that stands in a public signature, by the module that it is in."""
__all__ = [
    "CameraImage",
    "Detection",
    "Detector",
    "Frame",
    "MethodSettings",
    "ObjectModel",
    "PoseFit",
    "Rejection",
    "RgbdFrame",
    "RunnerUp",
    "SearchResult",
    "TrackedDetection",
    "Tracker",
    "TrackingResult",
    "TrackingSettings",
]


def __getattr__(name: str) -> Any:
    # Imported at first use, so that `import hlp` alone, as in the command line, stays fast.
    for module, names in _HOMES.items():
        if name in names:
            return getattr(import_module(module), name)
    raise AttributeError(f"module 'hlp' has no attribute {name!r}")
