"""rosbag2 files: the only writer and the only reader; every fault is named, none is fatal.

Nothing is imported here: hosts need the rows of `bags.rows` alone, and have to start fast.
"""
