"""`hlp predict`: poses of a user's own object in their own frames."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hlp.commands import composing
from hlp.errors import ConfigError

if TYPE_CHECKING:
    from omegaconf import DictConfig

OWN_FILES = ("model", "rgb", "depth", "intrinsics")
OWN_UNITS = ("mesh_scale", "depth_scale")


def command(arguments: Sequence[str]) -> None:
    """Learn the object, unless that was done before, and find it in every frame."""
    if not arguments or composing.HELP & set(arguments):
        print(PREDICT_HELP)
        return
    overrides = ["experiment=predict", *map(_data_override, arguments)]
    composing.compose_and_call("predict", overrides, _predict, composing.config_folder())


def _predict(config: DictConfig) -> None:
    """Check that the files are given, then predict; what is learnt is kept for the next call."""
    from hydra.core.hydra_config import HydraConfig
    from omegaconf import OmegaConf

    for key in OWN_FILES:
        if OmegaConf.is_missing(config.data, key):
            raise ConfigError(f"{key} is not set: give {key}=…, see `hlp predict --help`")
    config.output = HydraConfig.get().runtime.output_dir

    from hlp.config import build
    from hlp.runs import prediction

    prediction.predict(build.build_run(config), Path(config.output))


def _data_override(argument: str) -> str:
    """`model=FILE` as an override of `data.model`, quoted because Hydra forbids some characters."""
    key, _, value = argument.partition("=")
    if key not in (*OWN_FILES, *OWN_UNITS):
        return argument
    if key in OWN_FILES and not value.startswith(("[", "'", '"')):
        value = "'" + os.path.expanduser(value).replace("'", "\\'") + "'"
    return f"data.{key}={value}"


PREDICT_HELP = """\
usage: hlp predict model=FILE rgb=PATH depth=PATH intrinsics=FILE|[fx,fy,cx,cy] [overrides]

Poses of your own object in your own RGB-D frames, from its CAD model alone.

  model        triangle mesh of the object (PLY, OBJ, STL …), in millimetres
  rgb          a colour image, or a folder of them
  depth        its 16-bit depth PNG, or a folder with the same names; registered to the colour
  intrinsics   JSON file with cam_K (nine numbers) or fx, fy, cx, cy, and optionally depth_scale;
               or the four numbers (px)

  mesh_scale   metres per unit of the model (default: 0.001; 1 for a model in metres)
  depth_scale  millimetres per unit of the depth images (default: the JSON file's, else 1)
  output       folder of the results (default: outputs/predict/TIME)
  work         folder that keeps what is learnt about the object (default: work)

hlp predict model=bracket.ply rgb=frame.png depth=frame_depth.png intrinsics=camera.json
hlp predict model=bracket.ply rgb=rgb/ depth=depth/ "intrinsics=[572.4,573.6,325.3,242.0]"

The first call learns the object, which takes minutes. Later calls only detect it. Detection works
better with photographs and RGB-D frames of places like yours as training backgrounds, without the
object in them:
  data.photographs=FOLDER   data.rooms=FOLDER (with rgb/, depth/ and camera.json)
All groups and keys of `hlp run` can be changed too, e.g. refinement=icp or method=paper.

Written into the output folder: poses.csv (BOP's format), poses.json, and panels/ with a picture
of each frame. R and t (mm) map object coordinates to camera coordinates (x right, y down, z
forward)."""
