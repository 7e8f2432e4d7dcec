"""The public names of lsvision, in the order of the data flow.

Read by type checkers, and by `lazy_loader`, which imports each name on its first use: a name is
made public here and nowhere else.
"""

from .geometry import (
    Pose as Pose,
    Plane as Plane,
    Ellipse as Ellipse,
    Cylinder as Cylinder,
)
from .profile import (
    Profile as Profile,
    Arc as Arc,
    NoiseModel as NoiseModel,
    PointNoise as PointNoise,
)
from .io.profiles import (
    read_profile as read_profile,
    read_profiles as read_profiles,
    inspect_profiles as inspect_profiles,
)
from .sensors.profile_sensor import (
    ProfileSensor as ProfileSensor,
    LPS36 as LPS36,
    LPS36HI as LPS36HI,
)
from .io.images import read_image as read_image
from .laser_line.extraction import extract_laser_line as extract_laser_line
from .laser_line.line import LaserLine as LaserLine
from .laser_line.settings import LineSettings as LineSettings
from .sensors.camera import Camera as Camera
from .sensors.light_section import LightSection as LightSection
from .measure import (
    measure_cylinders as measure_cylinders,
    Measurement as Measurement,
    Settings as Settings,
)
from .batch.measure_many import measure_many as measure_many
from .ellipse.section import CylinderSection as CylinderSection
from .detection.arcs import Rejection as Rejection
from .cylinder.robot_frame import (
    place_section as place_section,
    PlacedCylinder as PlacedCylinder,
)
from .scan import (
    measure_scan as measure_scan,
    measure_shape as measure_shape,
    ScanMeasurement as ScanMeasurement,
    ScannedCylinder as ScannedCylinder,
    ScanSettings as ScanSettings,
)
from .cylinder.fit import (
    fit_cylinder as fit_cylinder,
    CylinderFittingSettings as CylinderFittingSettings,
)
from .ellipse.problem import RadiusPrior as RadiusPrior
from .planning import (
    plan_section as plan_section,
    plan_scan as plan_scan,
    sections_needed as sections_needed,
)
from .inspection.job import Job as Job
from .inspection.judge import judge as judge
from .inspection.verdict import Verdict as Verdict
from .inspection.decision import Decision as Decision
from .inspection.relate import relate as relate
from .inspection.relation import Relation as Relation
from .calibration.target import (
    ChArUco as ChArUco,
    Chessboard as Chessboard,
    CircleGrid as CircleGrid,
)
from .calibration.intrinsics import calibrate_camera as calibrate_camera
from .calibration.laser_plane import calibrate_laser_plane as calibrate_laser_plane
from .calibration.lens_blur import measure_lens_blur as measure_lens_blur
from .calibration.board_in_plane import calibrate_board_in_plane as calibrate_board_in_plane
from .calibration.hand_eye import (
    calibrate_hand_eye_sphere as calibrate_hand_eye_sphere,
    calibrate_hand_eye_plane as calibrate_hand_eye_plane,
    calibrate_hand_eye_board as calibrate_hand_eye_board,
)
from .calibration.hand_eye_result import HandEye as HandEye
from .calibration.pose_planning import (
    plan_hand_eye_poses as plan_hand_eye_poses,
    plan_hand_eye_poses_plane as plan_hand_eye_poses_plane,
)
from .io.robot_poses import read_robot_poses as read_robot_poses
from .io.hand_eye_file import (
    save_hand_eye as save_hand_eye,
    load_hand_eye as load_hand_eye,
)
from .draw import (
    draw_measurement as draw_measurement,
    draw_overlay as draw_overlay,
)
from . import simulate as simulate
from .errors import LsvisionError as LsvisionError

__version__: str
