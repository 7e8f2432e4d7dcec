"""Step 3, sensor to robot: ``python calibration/sensor_to_robot.py [FOLDER] --convention NAME``.

FOLDER/sphere holds one profile of a sphere for each robot pose, FOLDER/sphere_poses.csv the
poses of the flange. Without FOLDER the shipped example is taken (KUKA poses, sphere of 20 mm).
Options are those of ``lsvision calibrate hand-eye sphere``. Writes hand_eye.json,
hand_eye.yaml (easy_handeye) and hand_eye.html into FOLDER/results, or --results DIR.
"""

import argparse
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
EXAMPLE = HERE / "example"
sys.path.insert(0, str(HERE.parent))  # a checkout that is not installed runs too


def main() -> None:
    """Run ``lsvision calibrate hand-eye sphere`` on a folder."""
    from lsvision.cli import main as run

    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("folder", nargs="?", type=Path)
    words.add_argument("--results", type=Path)
    given, options = words.parse_known_args()
    folder = given.folder or EXAMPLE
    if given.folder is None:
        options = ["--convention", "kuka", "--radius", "20", *options]
    results = given.results or folder / "results"
    if folder.is_dir():
        results.mkdir(exist_ok=True)
    sys.argv = [
        *("lsvision", "calibrate", "hand-eye", "sphere", str(folder / "sphere")),
        *("--poses", str(folder / "sphere_poses.csv"), "--out", str(results / "hand_eye.json")),
        *("--easy-handeye", str(results / "hand_eye.yaml")),
        *("--report", str(results / "hand_eye.html"), *options),
    ]
    run()


if __name__ == "__main__":
    main()
