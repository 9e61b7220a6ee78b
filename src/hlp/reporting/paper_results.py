"""Results printed in the paper (Zhang & Cao, ICCV Workshops 2017)."""

ADD_BY_OBJECT = {
    "ape": 0.970,
    "benchvise": 0.951,
    "bowl": 0.999,
    "cam": 0.953,
    "can": 0.969,
    "cat": 0.979,
    "cup": 0.995,
    "driller": 0.960,
    "duck": 0.977,
    "eggbox": 0.999,
    "glue": 0.830,
    "holepuncher": 0.972,
    "iron": 0.989,
    "lamp": 0.949,
    "phone": 0.903,
}
"""ADD(-S) recall on LINEMOD's whole sequences (Table 1)."""

ADD_MEAN, ADD_STD = 0.960, 0.042
"""Mean and standard deviation over the objects, as printed in Table 1."""

OCCLUSION = {"add": 0.632, "5cm5deg": 0.362, "iou50": 0.799}
"""Recall on the Occlusion set (Table 2), by the keys of `summary.json`."""

OCCLUSION_BRACHMANN = {"add": 0.566, "5cm5deg": 0.227, "iou50": 0.620}
"""The same for Brachmann et al., as Table 2 quotes it."""

MS_PER_FRAME = 800.0
"""Approximate time of one frame on the authors' laptop (i7, GTX 970M)."""
