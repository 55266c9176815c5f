"""ROS 1 and ROS 2 bags, through the package rosbags (docs/convert.md, "ROS bags")."""
