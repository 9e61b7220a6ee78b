"""HLP: 6D pose of known, texture-poor objects in RGB-D images, from their CAD models alone.

A re-implementation of "Combined Holistic and Local Patches for Recovering 6D Object Pose"
(Zhang and Cao, ICCV Workshops 2017) as a configurable experiment framework.
"""

__version__ = "0.1.0"
