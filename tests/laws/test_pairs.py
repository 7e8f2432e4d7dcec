"""Settings that are pairs: one number, three, or text are rejected with what was wanted."""

import pytest

from lsvision.calibration.hand_eye_result import HandEyeSettings
from lsvision.calibration.pose_planning import PosePlanSettings
from lsvision.geometry import Cylinder, Ellipse, Pose
from lsvision.sensors.camera import Camera
from lsvision.sensors.profile_sensor import ProfileSensor
from lsvision.simulate.image_effects import StrayLight
from lsvision.simulate.imaging_rig import ImagingRig
from lsvision.simulate.scene_kinds import TubeRanges
from lsvision.simulate.section import SectionSettings
from lsvision.simulate.solids import Tube

MATRIX = [[800.0, 0.0, 320.0], [0.0, 800.0, 240.0], [0.0, 0.0, 1.0]]
PAIRS = {
    "jump_mm": lambda pair: SectionSettings(jump_mm=pair),
    "brightness": lambda pair: StrayLight(brightness=pair),
    "radius_mm": lambda pair: TubeRanges(radius_mm=pair),
    "theta_deg": lambda pair: TubeRanges(theta_deg=pair),
    "phi_deg": lambda pair: TubeRanges(phi_deg=pair),
    "a robot_std": lambda pair: HandEyeSettings(robot_std=pair),
    "line_std": lambda pair: PosePlanSettings(line_std=pair),
    "robot_std": lambda pair: PosePlanSettings(robot_std=pair),
    "an origin": lambda pair: ProfileSensor(origin=pair),
    "a centre": lambda pair: Ellipse(pair, 20.0, 19.0, 0.0),
    "a span": lambda pair: Tube(Cylinder([0, 0, 0], [0, 0, 1], 9.0), span=pair),
    "a size": lambda pair: Camera(MATRIX, [], pair),
    "a size of a rig|a size": lambda pair: ImagingRig(
        matrix=MATRIX, size=pair, camera_from_section=Pose.along((0, 0, 1), 300.0)
    ),
}


@pytest.mark.parametrize("name", PAIRS)
@pytest.mark.parametrize("pair", [(1,), (1, 2, 3), (), "a", ("a", "b")])
def test_anything_but_two_numbers_is_rejected(name, pair):
    if name == "a centre" and "a" in pair:
        pytest.skip("the message of float() names the text")
    with pytest.raises(ValueError, match=f"expected ({name}).*, got") as raised:
        PAIRS[name](pair)
    assert repr(pair) in str(raised.value)
