"""Bounds of the waterfall, shared by the tests of this folder."""

from hlp.evaluation.settings import WaterfallSettings

BOUNDS = WaterfallSettings(
    basin_deg=30.0,
    basin_mm=30.0,
    vote_deg=15.0,
    vote_mm=20.0,
    good_votes=5,
    region_share=0.25,
    depth_share=0.5,
    flip_fraction=0.1,
)
