"""Step 3, sensor to robot: ``python calibration/sensor_to_robot.py [FOLDER] --convention NAME``.

FOLDER/sphere holds one profile of a sphere for each robot pose, FOLDER/sphere_poses.csv the
poses of the flange. Without FOLDER the shipped example is taken (KUKA poses, sphere of 20 mm).
Options are those of ``lsvision calibrate hand-eye sphere``. Writes hand_eye.json,
hand_eye.yaml (easy_handeye) and hand_eye.html into FOLDER/results, or --results DIR.
"""

from pathlib import Path

from steps import run_step

EXAMPLE_OPTIONS = ("--convention", "kuka", "--radius", "20")
"""Options that the shipped example needs: how its poses are written, radius of the sphere in mm."""


def command(folder: Path, results: Path) -> list[str]:
    """Return the arguments of ``lsvision calibrate`` for a folder with profiles and its results."""
    return [
        *("hand-eye", "sphere", str(folder / "sphere")),
        *("--poses", str(folder / "sphere_poses.csv"), "--out", str(results / "hand_eye.json")),
        *("--easy-handeye", str(results / "hand_eye.yaml")),
        *("--report", str(results / "hand_eye.html")),
    ]


if __name__ == "__main__":
    run_step(__doc__, command, EXAMPLE_OPTIONS)
