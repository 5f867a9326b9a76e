"""What a running platoon looks like: heard, put together, and shown in a terminal or a browser.

The node that hears is `cacc_platoon.supervision.watch_node`; nothing here needs ROS.
"""
