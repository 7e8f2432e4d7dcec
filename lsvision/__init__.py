"""Radius and orientation of cylinders from a light section, each number with its uncertainty.

The public names, in the order of the data flow. Each is imported from its module on first use,
so that ``lsvision --help`` does not wait for numpy, OpenCV and scipy.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lsvision import simulate as simulate
    from lsvision.calibration.board_in_plane import (
        calibrate_board_in_plane as calibrate_board_in_plane,
    )
    from lsvision.calibration.hand_eye import calibrate_hand_eye_board as calibrate_hand_eye_board
    from lsvision.calibration.hand_eye import calibrate_hand_eye_plane as calibrate_hand_eye_plane
    from lsvision.calibration.hand_eye import calibrate_hand_eye_sphere as calibrate_hand_eye_sphere
    from lsvision.calibration.hand_eye_result import HandEye as HandEye
    from lsvision.calibration.intrinsics import calibrate_camera as calibrate_camera
    from lsvision.calibration.laser_plane import calibrate_laser_plane as calibrate_laser_plane
    from lsvision.calibration.lens_blur import measure_lens_blur as measure_lens_blur
    from lsvision.calibration.pose_planning import plan_hand_eye_poses as plan_hand_eye_poses
    from lsvision.calibration.pose_planning import (
        plan_hand_eye_poses_plane as plan_hand_eye_poses_plane,
    )
    from lsvision.calibration.target import ChArUco as ChArUco
    from lsvision.calibration.target import Chessboard as Chessboard
    from lsvision.calibration.target import CircleGrid as CircleGrid
    from lsvision.cylinder.fit import fit_cylinder as fit_cylinder
    from lsvision.cylinder.robot_frame import PlacedCylinder as PlacedCylinder
    from lsvision.cylinder.robot_frame import place_section as place_section
    from lsvision.detection.arcs import Rejection as Rejection
    from lsvision.draw import draw_measurement as draw_measurement
    from lsvision.draw import draw_overlay as draw_overlay
    from lsvision.ellipse.section import CylinderSection as CylinderSection
    from lsvision.errors import LsvisionError as LsvisionError
    from lsvision.geometry import Cylinder as Cylinder
    from lsvision.geometry import Ellipse as Ellipse
    from lsvision.geometry import Plane as Plane
    from lsvision.geometry import Pose as Pose
    from lsvision.io.hand_eye_file import load_hand_eye as load_hand_eye
    from lsvision.io.hand_eye_file import save_hand_eye as save_hand_eye
    from lsvision.io.profiles import inspect_profiles as inspect_profiles
    from lsvision.io.profiles import read_profile as read_profile
    from lsvision.io.profiles import read_profiles as read_profiles
    from lsvision.io.robot_poses import read_robot_poses as read_robot_poses
    from lsvision.laser_line.extraction import LaserLine as LaserLine
    from lsvision.laser_line.extraction import extract_laser_line as extract_laser_line
    from lsvision.laser_line.settings import LineSettings as LineSettings
    from lsvision.measure import Measurement as Measurement
    from lsvision.measure import Settings as Settings
    from lsvision.measure import measure_cylinders as measure_cylinders
    from lsvision.planning import plan_scan as plan_scan
    from lsvision.planning import plan_section as plan_section
    from lsvision.planning import sections_needed as sections_needed
    from lsvision.profile import Arc as Arc
    from lsvision.profile import NoiseModel as NoiseModel
    from lsvision.profile import PointNoise as PointNoise
    from lsvision.profile import Profile as Profile
    from lsvision.scan import ScanMeasurement as ScanMeasurement
    from lsvision.scan import ScannedCylinder as ScannedCylinder
    from lsvision.scan import ScanSettings as ScanSettings
    from lsvision.scan import measure_scan as measure_scan
    from lsvision.scan import measure_shape as measure_shape
    from lsvision.sensors.camera import Camera as Camera
    from lsvision.sensors.light_section import LightSection as LightSection
    from lsvision.sensors.profile_sensor import LPS36 as LPS36
    from lsvision.sensors.profile_sensor import LPS36HI as LPS36HI
    from lsvision.sensors.profile_sensor import ProfileSensor as ProfileSensor

_PUBLIC_NAMES = {
    "Pose": "lsvision.geometry",
    "Plane": "lsvision.geometry",
    "Ellipse": "lsvision.geometry",
    "Cylinder": "lsvision.geometry",
    "Profile": "lsvision.profile",
    "Arc": "lsvision.profile",
    "NoiseModel": "lsvision.profile",
    "PointNoise": "lsvision.profile",
    "read_profile": "lsvision.io.profiles",
    "read_profiles": "lsvision.io.profiles",
    "inspect_profiles": "lsvision.io.profiles",
    "ProfileSensor": "lsvision.sensors.profile_sensor",
    "LPS36": "lsvision.sensors.profile_sensor",
    "LPS36HI": "lsvision.sensors.profile_sensor",
    "extract_laser_line": "lsvision.laser_line.extraction",
    "LaserLine": "lsvision.laser_line.extraction",
    "LineSettings": "lsvision.laser_line.settings",
    "Camera": "lsvision.sensors.camera",
    "LightSection": "lsvision.sensors.light_section",
    "measure_cylinders": "lsvision.measure",
    "Measurement": "lsvision.measure",
    "Settings": "lsvision.measure",
    "CylinderSection": "lsvision.ellipse.section",
    "Rejection": "lsvision.detection.arcs",
    "place_section": "lsvision.cylinder.robot_frame",
    "PlacedCylinder": "lsvision.cylinder.robot_frame",
    "measure_scan": "lsvision.scan",
    "measure_shape": "lsvision.scan",
    "ScanMeasurement": "lsvision.scan",
    "ScannedCylinder": "lsvision.scan",
    "ScanSettings": "lsvision.scan",
    "fit_cylinder": "lsvision.cylinder.fit",
    "plan_section": "lsvision.planning",
    "plan_scan": "lsvision.planning",
    "sections_needed": "lsvision.planning",
    "ChArUco": "lsvision.calibration.target",
    "Chessboard": "lsvision.calibration.target",
    "CircleGrid": "lsvision.calibration.target",
    "calibrate_camera": "lsvision.calibration.intrinsics",
    "calibrate_laser_plane": "lsvision.calibration.laser_plane",
    "measure_lens_blur": "lsvision.calibration.lens_blur",
    "calibrate_board_in_plane": "lsvision.calibration.board_in_plane",
    "calibrate_hand_eye_sphere": "lsvision.calibration.hand_eye",
    "calibrate_hand_eye_plane": "lsvision.calibration.hand_eye",
    "calibrate_hand_eye_board": "lsvision.calibration.hand_eye",
    "HandEye": "lsvision.calibration.hand_eye_result",
    "plan_hand_eye_poses": "lsvision.calibration.pose_planning",
    "plan_hand_eye_poses_plane": "lsvision.calibration.pose_planning",
    "read_robot_poses": "lsvision.io.robot_poses",
    "save_hand_eye": "lsvision.io.hand_eye_file",
    "load_hand_eye": "lsvision.io.hand_eye_file",
    "draw_measurement": "lsvision.draw",
    "draw_overlay": "lsvision.draw",
    "LsvisionError": "lsvision.errors",
}

__all__ = [*_PUBLIC_NAMES, "simulate"]  # noqa: PLE0604 - one table, not two lists to keep alike


def __getattr__(name: str) -> Any:
    if name == "simulate":
        return importlib.import_module("lsvision.simulate")
    if name not in _PUBLIC_NAMES:
        raise AttributeError(f"module 'lsvision' has no attribute '{name}'")
    return getattr(importlib.import_module(_PUBLIC_NAMES[name]), name)


def __dir__() -> list[str]:
    return __all__
