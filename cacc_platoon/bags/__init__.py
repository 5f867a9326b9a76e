"""rosbag2 files: the only writer and the only reader; every fault is named, none is fatal."""

from cacc_platoon.bags.raw import BagError
from cacc_platoon.bags.read import RawBag, read_bag
from cacc_platoon.bags.write import write_bag

__all__ = ["BagError", "RawBag", "read_bag", "write_bag"]
