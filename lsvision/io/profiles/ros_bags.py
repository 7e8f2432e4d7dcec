"""ROS bags and MCAP files: refused, with the commands that write what is read."""

from lsvision.errors import UnreadableFile
from lsvision.io.profiles.settings import RawProfiles, ReadSettings


def read_ros_bag(content: bytes, _: ReadSettings) -> RawProfiles:
    """Refuse a ROS bag.

    Raises
    ------
    UnreadableFile
        Always: with the commands that write its scans in a form that is read.
    """
    raise UnreadableFile(
        f"a ROS bag of {len(content)} bytes is not read: write its LaserScan messages as text with "
        "rostopic echo -b FILE -p /scan > scans.csv, or its clouds as PCD"
    )
