"""Step 1, the camera: ``python calibration/camera.py [FOLDER] [options of calibrate camera]``.

FOLDER/boards holds images of the target; without FOLDER the shipped example is taken. Writes
camera.json, camera.yaml (OpenCV, ROS) and camera.html into FOLDER/results, or --results DIR.
"""

import argparse
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))  # a checkout that is not installed runs too


def main() -> None:
    """Run ``lsvision calibrate camera`` on a folder."""
    from lsvision.cli import main as run

    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("folder", nargs="?", type=Path, default=HERE / "example")
    words.add_argument("--results", type=Path)
    given, options = words.parse_known_args()
    results = given.results or given.folder / "results"
    if given.folder.is_dir():
        results.mkdir(exist_ok=True)
    sys.argv = [
        *("lsvision", "calibrate", "camera", str(given.folder / "boards")),
        *("--out", str(results / "camera.json"), "--ros-yaml", str(results / "camera.yaml")),
        *("--report", str(results / "camera.html"), *options),
    ]
    run()


if __name__ == "__main__":
    main()
