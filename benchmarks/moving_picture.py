"""A moving picture of a run's poses, drawn over the frames that they were found in.

    python benchmarks/moving_picture.py outputs/ycbv /path/to/ycbv poses.webp

The run has a poses.csv, the data set is in BOP's layout. Of each scene, the first frame is shown as
it is, and then all of them with the models at their poses. The quality is the best with which the
file stays below a size. Check the data set's licence, and name its authors, before you show it.
"""

import argparse
from pathlib import Path

from PIL import Image

from hlp.data.bop import BopSettings
from hlp.files import POSES
from hlp.reporting.figures.panels import draw_detections
from hlp.results.poses_file import read_poses

FIRST_MS, EACH_MS, LAST_MS = 700, 200, 900


def main() -> None:
    """Draw, shrink, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="folder of the run")
    parser.add_argument("data", type=Path, help="data set whose frames it has processed")
    parser.add_argument("output", type=Path, help="picture to write (.webp)")
    parser.add_argument("--width", type=int, default=480)
    parser.add_argument("--most-bytes", type=int, default=300_000)
    parser.add_argument("--min-score", type=float, default=0.5)
    given = parser.parse_args()
    pictures, milliseconds = draw(given.run, given.data, given.min_score)
    size = given.width, given.width * pictures[0].height // pictures[0].width
    small = [each.resize(size, Image.Resampling.LANCZOS) for each in pictures]
    for quality in range(90, 10, -5):
        small[0].save(
            given.output,
            save_all=True,
            quality=quality,
            append_images=small[1:],
            duration=milliseconds,
            loop=0,
            method=6,
        )
        written = given.output.stat().st_size
        if written <= given.most_bytes:
            break
    print(f"{given.output}: {len(small)} pictures, quality {quality}, {written} bytes")


def draw(run: Path, root: Path, min_score: float) -> tuple[list[Image.Image], list[int]]:
    """The pictures, and how long each is shown (ms)."""
    dataset = BopSettings(root=str(root)).build()
    found = [each for each in read_poses(run / POSES) if each.score >= min_score]
    pictures: list[Image.Image] = []
    shown: list[int] = []
    scene = None
    for key in dataset.frames.keys:
        frame = dataset.frames.load(key)
        if frame.scene_id != scene:
            if scene is not None:
                shown[-1] = LAST_MS
            scene = frame.scene_id
            pictures.append(Image.fromarray(frame.rgb))
            shown.append(FIRST_MS)
        here = [e for e in found if (e.scene_id, e.frame_id) == (frame.scene_id, frame.frame_id)]
        poses = [
            (dataset.models[each.object_id], each.pose_cam_obj)
            for each in here
            if each.pose_cam_obj is not None
        ]
        pictures.append(Image.fromarray(draw_detections(frame, poses)))
        shown.append(EACH_MS)
    shown[-1] = LAST_MS
    return pictures, shown


if __name__ == "__main__":
    main()
