"""A session for ROS 2: our records as its standard messages, over DDS or in a bag.

`cyclonedds` and `rosbags`, the extra `ros2`, are imported by the modules that speak ROS 2 and never
by the application, which knows `wire` alone.
"""
