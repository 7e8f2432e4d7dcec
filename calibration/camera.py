"""Step 1, the camera: ``python calibration/camera.py [FOLDER] [options of calibrate camera]``.

FOLDER/boards holds images of the target; without FOLDER the shipped example is taken. Writes
camera.json, camera.yaml (OpenCV, ROS) and camera.html into FOLDER/results, or --results DIR.
"""

from pathlib import Path

from steps import run_step


def command(folder: Path, results: Path) -> list[str]:
    """Return the arguments of ``lsvision calibrate`` for a folder with images and its results."""
    return [
        *("camera", str(folder / "boards"), "--out", str(results / "camera.json")),
        *("--ros-yaml", str(results / "camera.yaml"), "--report", str(results / "camera.html")),
    ]


if __name__ == "__main__":
    run_step(__doc__, command)
