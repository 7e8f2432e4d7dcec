"""Step 2, the laser plane: ``python calibration/laser_plane.py [FOLDER] [options]``.

FOLDER/boards holds images of the board evenly lit, FOLDER/lines the laser line on it, pose by
pose in the same order; FOLDER/results/camera.json comes from step 1. Without FOLDER the
shipped example is taken. Options are those of ``lsvision calibrate laser-plane``. Writes
rig.json, laser_plane.json (covariance, residuals) and rig.html beside camera.json.
"""

from pathlib import Path

from steps import run_step


def command(folder: Path, results: Path) -> list[str]:
    """Return the arguments of ``lsvision calibrate`` for a folder with images and its results."""
    return [
        *("laser-plane", "--camera", str(results / "camera.json")),
        *("--boards", str(folder / "boards"), "--lines", str(folder / "lines")),
        *("--out", str(results / "rig.json"), "--details", str(results / "laser_plane.json")),
        *("--report", str(results / "rig.html")),
    ]


if __name__ == "__main__":
    run_step(__doc__, command)
