"""Step 2, the laser plane: ``python calibration/laser_plane.py [FOLDER] [options]``.

FOLDER/boards holds images of the board evenly lit, FOLDER/lines the laser line on it, pose by
pose in the same order; FOLDER/results/camera.json comes from step 1. Without FOLDER the
shipped example is taken. Options are those of ``lsvision calibrate laser-plane``. Writes
rig.json, laser_plane.json (covariance, residuals) and rig.html beside camera.json.
"""

import argparse
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))  # a checkout that is not installed runs too


def main() -> None:
    """Run ``lsvision calibrate laser-plane`` on a folder."""
    from lsvision.cli import main as run

    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("folder", nargs="?", type=Path, default=HERE / "example")
    words.add_argument("--results", type=Path)
    given, options = words.parse_known_args()
    results = given.results or given.folder / "results"
    if given.folder.is_dir():
        results.mkdir(exist_ok=True)
    sys.argv = [
        *("lsvision", "calibrate", "laser-plane", "--camera", str(results / "camera.json")),
        *("--boards", str(given.folder / "boards"), "--lines", str(given.folder / "lines")),
        *("--out", str(results / "rig.json"), "--details", str(results / "laser_plane.json")),
        *("--report", str(results / "rig.html"), *options),
    ]
    run()


if __name__ == "__main__":
    main()
