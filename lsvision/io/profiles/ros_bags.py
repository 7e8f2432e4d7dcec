"""ROS bags and MCAP files: an error with the commands that convert them."""

from lsvision.errors import UnreadableFile
from lsvision.io.profiles.settings import RawProfiles, ReadSettings


def read_ros_bag(content: bytes, _: ReadSettings) -> RawProfiles:
    """Raise an error for a ROS bag.

    Raises
    ------
    UnreadableFile
        Always: with the commands that write its scans in a form that is read.
    """
    raise UnreadableFile(
        f"a ROS bag of {len(content)} bytes is not read: write its LaserScan messages as text with "
        "rostopic echo -b FILE -p /scan > scans.csv, or its clouds as PCD"
    )
